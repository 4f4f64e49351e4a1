#include "server/rpc/model_service.h"

#include <gmock/gmock.h>
#include <google/protobuf/util/json_util.h>

#include <cmath>
#include <fstream>
#include <optional>
#include <thread>

#include "tests/integration/raw_http2.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/server/rpc/server_fixture.h"

namespace maneuver::rpc::model_service_test {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class ModelServiceTest : public ServerTest {
 protected:
  // Writes the manifest of town/1: three actions that stand still, the second of them labelled.
  //   points: of the mean trajectory of each action
  void WriteManifest(v1::TrajectoryReference reference, int points = 1) {
    v1::ModelManifest manifest;
    manifest.set_format_version(1);
    v1::ModelSpec& spec = *manifest.mutable_spec();
    spec = artifact::TinySpec();
    spec.set_reference(reference);
    spec.mutable_scene_vectors()->set_history_width(4);
    spec.mutable_scene_vectors()->set_features(4);
    for (int id = 0; id < spec.actions(); ++id) {
      v1::Action& action = *manifest.add_actions();
      action.set_action_id(id);
      action.set_usage(0.25);
      action.set_effective(id != 2);
      v1::Trajectory& mean = *action.mutable_distribution()->mutable_mean_trajectory();
      for (int i = 0; i < points; ++i) {
        mean.add_x(id == 2 ? -3.0 : 0.0);
        mean.add_y(0.0);
      }
    }
    manifest.mutable_actions(1)->set_label("keeps going");
    std::string json;
    ASSERT_TRUE(google::protobuf::util::MessageToJsonString(manifest, &json).ok());
    std::ofstream(folder_ / "models" / "town" / "1" / "model.json") << json;
  }

  grpc::Status GetActionSet(std::optional<double> speed, v1::ActionSet* set) {
    v1::GetActionSetRequest request;
    request.set_name("models/town");
    if (speed) request.set_speed(*speed);
    grpc::ClientContext context;
    return model_stub_->GetActionSet(&context, request, set);
  }
};

// The fake model's action k is k + the speed in metres ahead.
TEST_F(ModelServiceTest, DrawsRelativeActionsAtTheRequestedSpeed) {
  Publish();
  WriteManifest(v1::TRAJECTORY_REFERENCE_FADING_MOTION);
  v1::ActionSet set;
  ASSERT_TRUE(GetActionSet(7.0, &set).ok());
  EXPECT_EQ(set.speed(), 7.0);
  ASSERT_EQ(set.actions_size(), 3);
  EXPECT_EQ(set.actions(1).distribution().mean_trajectory().x(0), 8.0);
  EXPECT_EQ(set.actions(1).distribution().probability(), 0.25);
  EXPECT_EQ(set.actions(1).label(), "keeps going");
  EXPECT_EQ(set.actions(1).usage(), 0.25);
  EXPECT_TRUE(set.actions(1).effective());
  EXPECT_FALSE(set.actions(2).effective());
  // As stored.
  ASSERT_TRUE(GetActionSet(std::nullopt, &set).ok());
  EXPECT_EQ(set.speed(), 10.0);
  EXPECT_EQ(set.actions(1).distribution().mean_trajectory().x(0), 0.0);
}

TEST_F(ModelServiceTest, AbsoluteActionsAreTheSameAtEverySpeed) {
  Publish();
  WriteManifest(v1::TRAJECTORY_REFERENCE_NONE);
  v1::ActionSet set;
  ASSERT_TRUE(GetActionSet(7.0, &set).ok());
  EXPECT_FALSE(set.has_speed());
  EXPECT_EQ(set.actions(1).distribution().mean_trajectory().x(0), 0.0);
}

TEST_F(ModelServiceTest, LabelsOverrideTheNamesOfActions) {
  Publish();
  WriteManifest(v1::TRAJECTORY_REFERENCE_NONE);
  v1::ActionSet set;
  ASSERT_TRUE(GetActionSet(std::nullopt, &set).ok());
  EXPECT_EQ(set.actions(0).display_name(), "stand still (1)");
  EXPECT_EQ(set.actions(1).display_name(), "keeps going");
  EXPECT_EQ(set.actions(2).display_name(), "reverse");

  v1::LabelActionRequest request;
  request.set_name("models/town/versions/1");
  request.set_action_id(2);
  request.set_label("parks");
  v1::Action labelled;
  {
    grpc::ClientContext context;
    ASSERT_TRUE(model_stub_->LabelAction(&context, request, &labelled).ok());
  }
  EXPECT_EQ(labelled.display_name(), "parks");
  EXPECT_EQ(labelled.derived_name(), "reverse");
  request.clear_label();
  grpc::ClientContext context;
  ASSERT_TRUE(model_stub_->LabelAction(&context, request, &labelled).ok());
  EXPECT_EQ(labelled.display_name(), "reverse");
}

// They would reach the terminals of all who read the label; a blank one names nothing.
TEST_F(ModelServiceTest, RefusesALabelThatIsBlankOrHasControlCharacters) {
  Publish();
  WriteManifest(v1::TRAJECTORY_REFERENCE_NONE);
  v1::LabelActionRequest request;
  request.set_name("models/town/versions/1");
  for (const char* label : {"a\x1b[31m", "two\nlines", "del\x7f", " ", "   ", "right\u202etfel",
                            "csi\xc2\x9b"
                            "31m"}) {
    request.set_label(label);
    grpc::ClientContext context;
    v1::Action labelled;
    EXPECT_EQ(model_stub_->LabelAction(&context, request, &labelled).error_code(),
              grpc::StatusCode::INVALID_ARGUMENT)
        << label;
  }
  request.set_label("B\xc3\xbcrgersteig \xe2\x86\x92");
  grpc::ClientContext context;
  v1::Action labelled;
  EXPECT_TRUE(model_stub_->LabelAction(&context, request, &labelled).ok());
}

// The fake model in memory has no action set: its actions have numbers for names, until a label is
// given.
TEST_F(ModelServiceTest, ANewLabelAppearsInPredictionsAtOnce) {
  Publish();
  WriteManifest(v1::TRAJECTORY_REFERENCE_NONE);
  v1::PredictRequest scene = OneScene();
  scene.set_include_action_names(true);
  v1::PredictResponse response;
  ASSERT_TRUE(Predict(scene, &response).ok());
  EXPECT_THAT(response.action_names(), ElementsAre("action 0", "action 1", "action 2"));

  v1::LabelActionRequest request;
  request.set_name("models/town/versions/1");
  request.set_action_id(2);
  request.set_label("parks");
  v1::Action labelled;
  grpc::ClientContext context;
  ASSERT_TRUE(model_stub_->LabelAction(&context, request, &labelled).ok());
  scene.add_required_action_names("parks");
  ASSERT_TRUE(Predict(scene, &response).ok());
  EXPECT_THAT(response.action_names(), ElementsAre("stand still (1)", "keeps going", "parks"));
}

TEST_F(ModelServiceTest, AnswersThatNobodyReadsRefuseOthersUntilTheirCallerHasGone) {
  Publish();
  WriteManifest(v1::TRAJECTORY_REFERENCE_NONE, 20'000);  // about a megabyte of actions
  constexpr int kKept = 4096;
  std::optional<integration::RawHttp2> reader(std::in_place, server_->address().ToString(), kKept);
  reader->SendPreface();
  reader->SendSettingsWithoutFlowControl();
  v1::GetActionSetRequest request;
  request.set_name("models/town");
  v1::ActionSet set;
  grpc::Status status;
  // The kernel keeps some megabytes.
  for (int i = 0; i < 100 && status.ok(); ++i) {
    reader->OpenCall(2 * i + 1, "/maneuver.v1.ModelService/GetActionSet");
    reader->SendMessage(2 * i + 1, request.SerializeAsString());
    status = GetActionSet(std::nullopt, &set);
  }
  EXPECT_EQ(Reason(status), "SEND_MEMORY_FULL");
  EXPECT_LE(SendMemory(), 8 << 20);
  reader.reset();
  while (SendMemory() > 0.0) std::this_thread::yield();
  EXPECT_TRUE(GetActionSet(std::nullopt, &set).ok());
}

TEST_F(ModelServiceTest, AChunkThatNobodyTakesCountsAsSendMemory) {
  Publish();
  WriteManifest(v1::TRAJECTORY_REFERENCE_NONE);
  std::ofstream(folder_ / "models" / "town" / "1" / "weights.safetensors")
      << std::string(3 << 20, 'x');
  v1::DownloadModelVersionRequest request;
  request.set_name("models/town");
  v1::DownloadModelVersionResponse response;
  {
    grpc::ClientContext context;
    const auto download = model_stub_->DownloadModelVersion(&context, request);
    while (SendMemory() < 1 << 20) std::this_thread::yield();
    EXPECT_LT(SendMemory(), 2 << 20);
    context.TryCancel();
    download->Finish();
  }
  while (SendMemory() > 0.0) std::this_thread::yield();
  const serving::SendMemory::Share unread = send_memory_.Take(8 << 20);
  grpc::ClientContext context;
  const auto download = model_stub_->DownloadModelVersion(&context, request);
  EXPECT_FALSE(download->Read(&response));
  EXPECT_EQ(Reason(download->Finish()), "SEND_MEMORY_FULL");
}

TEST_F(ModelServiceTest, RefusesAnImpossibleSpeed) {
  Publish();
  WriteManifest(v1::TRAJECTORY_REFERENCE_FADING_MOTION);
  for (const double speed : {-1.0, 101.0, std::nan("")}) {
    v1::ActionSet set;
    EXPECT_EQ(GetActionSet(speed, &set).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  }
}

TEST_F(ModelServiceTest, ListsVersionsNewestFirstInPages) {
  for (int i = 0; i < 5; ++i) Publish();
  v1::ListModelVersionsRequest request;
  request.set_parent("models/-");
  request.set_page_size(2);
  std::vector<std::string> names;
  do {
    v1::ListModelVersionsResponse response;
    grpc::ClientContext context;
    const grpc::Status status = model_stub_->ListModelVersions(&context, request, &response);
    ASSERT_TRUE(status.ok()) << status.error_message();
    for (const auto& version : response.model_versions())
      names.push_back(version.name().substr(21));
    request.set_page_token(response.next_page_token());
  } while (!request.page_token().empty());
  EXPECT_THAT(names, ElementsAre("5", "4", "3", "2", "1"));

  request.set_page_token("nonsense");
  v1::ListModelVersionsResponse response;
  grpc::ClientContext context;
  EXPECT_EQ(model_stub_->ListModelVersions(&context, request, &response).error_code(),
            grpc::StatusCode::INVALID_ARGUMENT);
}

class RequirementsTest : public ModelServiceTest {
 protected:
  void SetUp() override {
    ModelServiceTest::SetUp();
    Publish();
    request_.set_name("models/town/aliases/candidate");
    request_.set_model_version("models/town/versions/1");
  }

  // A report of town/1 on datasets/unseen, with `upper` the end of the interval of constant
  // velocity at 5-10 m/s.
  void Keep(double upper) {
    v1::EvaluationReport report;
    report.set_model_version("models/town/versions/1");
    report.set_dataset("datasets/unseen");
    for (const char* name : {"", "5-10 m/s"}) {
      v1::RivalStanding& part = *report.mutable_rivals()->add_parts();
      if (*name != '\0') part.set_dimension("speed");
      part.set_name(name);
      part.set_examples(400);
      part.set_groups(40);
      v1::RivalComparison& comparison = *part.add_comparisons();
      comparison.set_metric("ade_1");
      comparison.set_rival("cv");
      const bool ahead = *name == '\0' || upper < 0.0;
      comparison.mutable_difference()->set_value(-0.5);
      comparison.mutable_difference()->set_lower(-1.0);
      comparison.mutable_difference()->set_upper(ahead ? -0.125 : upper);
      comparison.set_verdict(ahead ? v1::RIVAL_VERDICT_AHEAD : v1::RIVAL_VERDICT_UNDECIDED);
    }
    ASSERT_TRUE(versions_->KeepReport(report).ok());
  }
  grpc::Status SetAlias() {
    grpc::ClientContext context;
    v1::ModelAlias alias;
    return model_stub_->SetModelAlias(&context, request_, &alias);
  }

  v1::SetModelAliasRequest request_;
};

TEST_F(RequirementsTest, MovesAnAliasOnlyIfTheReportMeetsTheRequirements) {
  v1::RivalRequirement& requirement = *request_.add_requirements();
  requirement.set_rival("cv");
  requirement.set_scope(v1::RIVAL_SCOPE_EVERY_STRATUM);
  request_.set_dataset("datasets/unseen");
  EXPECT_EQ(SetAlias().error_code(), grpc::StatusCode::NOT_FOUND);  // not evaluated yet

  Keep(0.25);
  const grpc::Status refused = SetAlias();
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_THAT(refused.error_message(),
              HasSubstr("not ahead of constant velocity by ade_1 in 5-10 m/s (-0.500 m, 95 % "
                        "-1.000 .. +0.250)"));
  EXPECT_THAT(refused.error_details(), HasSubstr("REQUIREMENTS_NOT_MET"));
  EXPECT_FALSE(
      models_->Resolve(security::ParseModelReference("models/town@candidate", "").value()).ok());

  Keep(-0.125);
  const grpc::Status moved = SetAlias();
  EXPECT_TRUE(moved.ok()) << moved.error_message();
}

TEST_F(RequirementsTest, RefusesInvalidRequirements) {
  Keep(-0.125);
  request_.set_dataset("datasets/unseen");
  EXPECT_EQ(SetAlias().error_code(), grpc::StatusCode::INVALID_ARGUMENT);  // for nothing
  request_.add_requirements()->set_rival("nobody");
  EXPECT_EQ(SetAlias().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  request_.mutable_requirements(0)->set_rival("cv");
  request_.clear_dataset();
  EXPECT_EQ(SetAlias().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  for (int i = 0; i < 20; ++i) request_.add_requirements()->set_rival("cv");
  request_.set_dataset("datasets/unseen");
  EXPECT_EQ(SetAlias().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(RequirementsTest, AReportWithoutRivalsIsOutdated) {
  v1::EvaluationReport report;
  report.set_model_version("models/town/versions/1");
  report.set_dataset("datasets/unseen");
  ASSERT_TRUE(versions_->KeepReport(report).ok());
  request_.add_requirements()->set_rival("cv");
  request_.set_dataset("datasets/unseen");
  const grpc::Status refused = SetAlias();
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_THAT(refused.error_message(), HasSubstr("evaluate the version on datasets/unseen again"));
}

TEST_F(ModelServiceTest, ListsReportsNewestFirstInPagesAndReadsThemWhole) {
  Publish();
  int64_t seconds = 0;
  for (const char* dataset : {"a", "b", "c", "d", "e"}) {
    v1::EvaluationReport report;
    report.set_model_version("models/town/versions/1");
    report.set_dataset(std::string("datasets/") + dataset);
    report.mutable_create_time()->set_seconds(++seconds);
    report.add_strata()->set_name("left");
    report.mutable_rivals()->set_groups(7);
    ASSERT_TRUE(versions_->KeepReport(report).ok());
  }
  v1::ListEvaluationReportsRequest request;
  request.set_parent("models/town");  // what serves
  request.set_page_size(2);
  std::vector<std::string> datasets;
  std::string last;
  do {
    v1::ListEvaluationReportsResponse response;
    grpc::ClientContext context;
    const grpc::Status status = model_stub_->ListEvaluationReports(&context, request, &response);
    ASSERT_TRUE(status.ok()) << status.error_message();
    EXPECT_LE(response.evaluation_reports_size(), 2);
    for (const auto& report : response.evaluation_reports()) {
      EXPECT_FALSE(report.has_rivals());
      datasets.push_back(report.dataset().substr(9));
      last = report.name();
    }
    request.set_page_token(response.next_page_token());
  } while (!request.page_token().empty());
  EXPECT_THAT(datasets, ElementsAre("e", "d", "c", "b", "a"));

  v1::GetEvaluationReportRequest get;
  get.set_name(last);
  v1::EvaluationReport report;
  {
    grpc::ClientContext context;
    ASSERT_TRUE(model_stub_->GetEvaluationReport(&context, get, &report).ok());
    EXPECT_EQ(report.dataset(), "datasets/a");
    EXPECT_EQ(report.strata_size(), 1);
  }
  {
    get.set_name("models/town/versions/1/evaluations/f");
    grpc::ClientContext context;
    const grpc::Status status = model_stub_->GetEvaluationReport(&context, get, &report);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::NOT_FOUND);
    EXPECT_EQ(Reason(status), "EVALUATION_NOT_FOUND");
  }
  request.set_page_token("nonsense");
  v1::ListEvaluationReportsResponse response;
  grpc::ClientContext context;
  EXPECT_EQ(model_stub_->ListEvaluationReports(&context, request, &response).error_code(),
            grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(ModelServiceTest, PromotesByAliasAndKeepsAnAliasedVersion) {
  Publish();
  Publish();
  v1::SetModelAliasRequest set;
  set.set_name("models/town/aliases/serving");
  set.set_model_version("models/town/versions/2");
  {
    v1::ModelAlias alias;
    grpc::ClientContext context;
    ASSERT_TRUE(model_stub_->SetModelAlias(&context, set, &alias).ok());
  }
  v1::PredictResponse response;
  ASSERT_TRUE(Predict(OneScene(), &response).ok());
  EXPECT_EQ(response.model_version(), "models/town/versions/2");

  v1::DeleteModelVersionRequest remove;
  google::protobuf::Empty empty;
  {
    remove.set_name("models/town/versions/2");
    grpc::ClientContext context;
    const grpc::Status status = model_stub_->DeleteModelVersion(&context, remove, &empty);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
    EXPECT_EQ(Reason(status), "MODEL_VERSION_IN_USE");
  }
  {
    remove.set_name("models/town/versions/1");
    grpc::ClientContext context;
    EXPECT_TRUE(model_stub_->DeleteModelVersion(&context, remove, &empty).ok());
  }
  set.set_model_version("models/city/versions/1");
  v1::ModelAlias alias;
  grpc::ClientContext context;
  EXPECT_EQ(model_stub_->SetModelAlias(&context, set, &alias).error_code(),
            grpc::StatusCode::INVALID_ARGUMENT);
}

}  // namespace
}  // namespace maneuver::rpc::model_service_test

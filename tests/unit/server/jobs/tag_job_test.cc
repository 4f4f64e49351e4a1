// Tagging as a job, with a real process as the trainer.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <string>

#include "model/files/durable_file.h"
#include "server/errors/error_details.h"
#include "server/jobs/job_requests.h"
#include "tests/unit/server/jobs/supervisor_fixture.h"

namespace maneuver::jobs::tag_job_test {
namespace {

using testing::HasSubstr;

v1::TagRequest Request() {
  v1::TagRequest request;
  request.set_model("models/town/versions/7");
  request.add_datasets("datasets/town");
  request.add_datasets("datasets/village");
  request.set_tags("tags/june");
  return request;
}

// Writes something into the folder of the tags, and its arguments beside itself.
constexpr char kWrites[] = "echo \"$arguments\" > \"${0%/*}/arguments\"; echo x > \"$output/note\"";

class TagJobTest : public SupervisorTest {
 protected:
  v1::Job Tag(const v1::TagRequest& request) {
    const auto job = supervisor_->Tag(request);
    EXPECT_TRUE(job.ok()) << job.status();
    return job.ok() ? *job : v1::Job();
  }
  std::string Text(const std::string& file) { return files::ReadFile(folder_ / file).value_or(""); }
};

TEST_F(TagJobTest, WritesIntoTheFolderOfItsTagsAndSaysWhatIsThere) {
  Trainer(kWrites);
  Start();
  v1::TagRequest request = Request();
  request.set_part(1);
  request.set_parts(4);
  request.mutable_stride()->set_nanos(500'000'000);
  const v1::Job job = WaitForEnd(Tag(request).name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_EQ(job.tagged().name(), "tags/june");
  EXPECT_EQ(job.tagged().model_version(), "models/town/versions/7");
  EXPECT_EQ(job.tagged().datasets_size(), 2);
  const std::string arguments = Text("arguments");
  EXPECT_THAT(arguments, HasSubstr("tag --model "));
  EXPECT_THAT(arguments, HasSubstr("--part 1 --parts 4"));
  EXPECT_THAT(arguments, HasSubstr("--stride 0.5"));
  EXPECT_THAT(arguments, HasSubstr("/datasets/town --dataset "));
  EXPECT_EQ(Text("tags/june/note"), "x\n");
}

TEST_F(TagJobTest, NamesTheVersionThatAnAliasPointedTo) {
  Trainer(kWrites);
  Start();
  v1::TagRequest request = Request();
  request.set_model("models/town");
  EXPECT_EQ(Tag(request).tag().model(), "models/town/versions/7");
}

// Dies after each shard.
TEST_F(TagJobTest, ContinuesAfterTheShardsThatAreComplete) {
  Trainer(std::string("mkdir -p \"$checkpoints\"; n=$(ls \"$checkpoints\" | wc -l)\n"
                      "[ $n -ge 2 ] || { touch \"$checkpoints/checkpoint-$((n + 1))\"; kill -9 $$; "
                      "}\n") +
          kWrites);
  Start();
  const v1::Job job = WaitForEnd(Tag(Request()).name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_EQ(job.attempts().started(), 3);
}

TEST_F(TagJobTest, CanBeCancelledAndResumed) {
  Trainer(kRunsOn);
  Start();
  const std::string name = Tag(Request()).name();
  WaitForProgress(name);
  ASSERT_TRUE(supervisor_->Cancel(name).ok());
  EXPECT_EQ(WaitForEnd(name).state(), v1::JOB_STATE_CANCELLED);
  // Also after somebody has deleted what was there.
  ASSERT_TRUE(supervisor_->DeleteTags("june").ok());
  Trainer(kWrites);
  ASSERT_TRUE(supervisor_->Resume(name).ok());
  WaitFor(name, [](const v1::Job& job) { return job.state() == v1::JOB_STATE_SUCCEEDED; });
  EXPECT_EQ(Text("tags/june/note"), "x\n");
}

TEST_F(TagJobTest, RefusesTagsOfTheSameNameThatWouldDiffer) {
  Trainer(kWrites);
  Start();
  WaitForEnd(Tag(Request()).name());
  const auto refuses = [&](const std::string& field, auto change) {
    v1::TagRequest request = Request();
    change(request);
    const absl::Status status = supervisor_->Tag(request).status();
    EXPECT_EQ(errors::ReasonOf(status), "TAGS_EXIST") << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr(field));
  };
  refuses("model_version", [](auto& r) { r.set_model("models/town/versions/8"); });
  refuses("datasets", [](auto& r) { r.mutable_datasets()->RemoveLast(); });
  refuses("windows", [](auto& r) { r.set_windows(true); });
  refuses("stride", [](auto& r) { r.mutable_stride()->set_seconds(1); });
  // Another part completes them.
  v1::TagRequest request = Request();
  request.set_parts(2);
  request.set_part(1);
  EXPECT_EQ(WaitForEnd(Tag(request).name()).state(), v1::JOB_STATE_SUCCEEDED);
}

TEST_F(TagJobTest, ARequestThatIsRefusedLeavesNoTags) {
  Trainer(kRunsOn);
  SupervisorOptions options = Options();
  options.new_id = [] { return "same"; };  // so that the store takes the first job alone
  StartWith(std::move(options));
  Tag(Request());
  v1::TagRequest request = Request();
  ASSERT_FALSE(supervisor_->Tag(request).ok());
  EXPECT_TRUE(supervisor_->tag_store().Contains("june")) << "the first job's tags stay";
  request.set_tags("tags/july");
  ASSERT_FALSE(supervisor_->Tag(request).ok());
  EXPECT_FALSE(supervisor_->tag_store().Contains("july"));
}

TEST_F(TagJobTest, TagsAndDatasetsStayWhileAJobNeedsThem) {
  Trainer(kRunsOn);
  Start();
  const std::string name = Tag(Request()).name();
  EXPECT_EQ(errors::ReasonOf(supervisor_->DeleteTags("june")), "TAGS_IN_USE");
  EXPECT_TRUE(absl::IsFailedPrecondition(supervisor_->DeleteDataset("village")));
  ASSERT_TRUE(supervisor_->Cancel(name).ok());
  WaitForEnd(name);
  EXPECT_TRUE(supervisor_->DeleteTags("june").ok());
  EXPECT_TRUE(absl::IsNotFound(supervisor_->DeleteTags("june")));
  EXPECT_FALSE(supervisor_->tag_store().Contains("june"));
}

TEST_F(TagJobTest, KeepsToItsQuota) {
  Trainer(std::string("echo \"$arguments\" > \"${0%/*}/arguments\"; exit 84"));
  SupervisorOptions options = Options();
  options.tag_quota_bytes = 1'000;
  StartWith(std::move(options));
  // The trainer learns how much room there is, and says when it has used it up.
  const v1::Job job = WaitForEnd(Tag(Request()).name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_FAILED);
  EXPECT_EQ(ReasonOf(job), "TAG_QUOTA");
  EXPECT_THAT(Text("arguments"), testing::ContainsRegex("--room [0-9]+"));
  std::ofstream(folder_ / "tags/june/large") << std::string(1'000, 'x');
  v1::TagRequest request = Request();
  request.set_tags("tags/july");
  EXPECT_EQ(errors::ReasonOf(supervisor_->Tag(request).status()), "TAG_QUOTA");
}

TEST_F(TagJobTest, TheSameRequestIdReturnsTheSameJobAndValidationStartsNothing) {
  Trainer(kWrites);
  Start();
  v1::TagRequest request = Request();
  request.set_validate_only(true);
  EXPECT_EQ(Tag(request).name(), "");
  EXPECT_FALSE(supervisor_->tag_store().Contains("june"));
  request.set_validate_only(false);
  request.set_request_id("once");
  const std::string name = Tag(request).name();
  EXPECT_EQ(Tag(request).name(), name);
  request.set_parts(3);
  EXPECT_TRUE(absl::IsAlreadyExists(supervisor_->Tag(request).status()));
}

TEST(TagRequestTest, RefusesInvalidRequests) {
  EXPECT_TRUE(CheckTagRequest(Request()).ok());
  const auto refuses = [](const std::string& field, auto change) {
    v1::TagRequest request = Request();
    change(request);
    const absl::Status status = CheckTagRequest(request);
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << field;
    EXPECT_THAT(std::string(status.message()), HasSubstr(field));
  };
  refuses("model", [](auto& r) { r.set_model("town"); });
  refuses("datasets", [](auto& r) { r.clear_datasets(); });
  refuses("datasets[1]", [](auto& r) { r.set_datasets(1, "datasets/town"); });
  refuses("tags", [](auto& r) { r.set_tags("june"); });
  refuses("tags", [](auto& r) { r.set_tags("tags/../june"); });
  refuses("parts", [](auto& r) { r.set_parts(-1); });
  refuses("parts", [](auto& r) { r.set_parts(10'001); });
  refuses("part", [](auto& r) { r.set_part(1); });
  refuses("part", [](auto& r) { r.set_part(-1); });
  refuses("stride", [](auto& r) { r.mutable_stride()->set_seconds(-1); });
  refuses("stride", [](auto& r) { r.mutable_stride(); });
  refuses("stride", [](auto& r) { r.mutable_stride()->set_seconds(3601); });
  refuses("stride", [](auto& r) { r.mutable_stride()->set_nanos(1'000'000'000); });
  refuses("priority", [](auto& r) { r.set_priority(101); });
  refuses("request_id", [](auto& r) { r.set_request_id(std::string(129, 'x')); });
}

}  // namespace
}  // namespace maneuver::jobs::tag_job_test

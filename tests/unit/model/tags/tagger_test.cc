#include "model/tags/tagger.h"

#include <gmock/gmock.h>
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/data/dataset_folder.h"
#include "model/data/example_index.h"
#include "model/data/town/synthetic_town.h"
#include "model/evaluation/evaluator.h"
#include "model/scene/road_map.h"
#include "model/scene/scene_reader.h"
#include "model/tags/tag_datasets.h"
#include "model/tags/tag_set.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/model/inference/reference_model.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::tags::tagger_test {
namespace {

std::shared_ptr<const inference::ActionModel> SmallModel() {
  return *inference::ActionModel::FromStored(inference::RandomModel(artifact::TinySpec(), 4),
                                             {.precision = inference::Precision::kF32});
}

v1::Scenario TownRecording() {
  data::town::TownOptions options;
  options.duration = 6.0;
  return data::town::GenerateRecording(options, 3).scenario;
}

TEST(TaggingExamplesTest, TakesTheStrideOfTheTrainingUnlessOneIsGiven) {
  v1::ModelManifest manifest;
  *manifest.mutable_spec() = artifact::TinySpec();
  v1::ExampleSettings& trained =
      *manifest.mutable_provenance()->mutable_settings()->mutable_examples();
  trained.mutable_stride()->set_seconds(2);
  trained.set_keep_standing(0.25);
  trained.set_max_speed(33.0);
  EXPECT_EQ(TaggingExamples(manifest, {}).stride().seconds(), 2);
  EXPECT_EQ(TaggingExamples(manifest, {}).max_speed(), 33.0);
  EXPECT_EQ(TaggingExamples(manifest, {}).keep_standing(), 1.0);
  EXPECT_EQ(TaggingExamples(manifest, 1.25).stride().seconds(), 1);
  EXPECT_EQ(TaggingExamples(manifest, 1.25).stride().nanos(), 250'000'000);
}

// The evaluator measures the same windows by a path of its own.
TEST(TaggerTest, AWindowHasWhatTheEvaluatorMeasures) {
  const auto model = SmallModel();
  const std::vector<v1::Scenario> recordings = {TownRecording()};
  const v1::ExampleSettings settings = TaggingExamples(model->manifest(), 0.7);
  Tagger tagger(model, {settings, /*merged=*/false});
  const std::vector<CsvRow> rows = tagger.Tag(recordings[0]);

  evaluation::EvaluationInput input;
  input.recordings = recordings;
  input.examples = settings;
  const auto measured = evaluation::BlockMeasurer(*model, input).Measure(recordings);
  ASSERT_TRUE(measured.ok()) << measured.status();
  ASSERT_EQ(rows.size(), measured->examples.size());
  std::vector<size_t> order(rows.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::ranges::sort(order, {}, [&](size_t i) {
    return std::tuple(measured->examples[i].target_id, measured->examples[i].time);
  });
  const auto number = [](const CsvRow& row, Column column) {
    return ToNumber(column, row.row[column]);
  };
  int classes = 0;
  for (size_t i = 0; i < rows.size(); ++i) {
    const data::Example& example = measured->examples[order[i]];
    const evaluation::Measurement& truth = measured->measured[order[i]];
    const CsvRow& row = rows[i];
    EXPECT_EQ(row.row[Column::kTarget], example.target_id);
    EXPECT_NEAR(number(row, Column::kFrom), example.time, 5.1e-4);
    EXPECT_EQ(row.row[Column::kFrom], row.row[Column::kTo]);
    EXPECT_EQ(row.row[Column::kFrom], row.row[Column::kPeak]);
    EXPECT_EQ(row.row[Column::kWindows], 1);
    EXPECT_EQ(row.row[Column::kAction], truth.action);
    EXPECT_NEAR(number(row, Column::kResponsibility), truth.responsibilities[truth.action], 5.1e-5);
    const double probability = truth.probabilities[truth.action];
    EXPECT_NEAR(number(row, Column::kProbability), probability, 5.1e-7);
    EXPECT_NEAR(number(row, Column::kSurprise), -std::log(probability), 5.1e-5);
    Eigen::Index likeliest = 0;
    truth.probabilities.maxCoeff(&likeliest);
    EXPECT_EQ(row.row[Column::kLikeliest], likeliest);
    EXPECT_NEAR(number(row, Column::kAde), truth.posterior.displacement[0].min_ade, 5.1e-3);
    EXPECT_NEAR(number(row, Column::kFde), truth.posterior.displacement[0].min_fde, 5.1e-3);
    EXPECT_NEAR(number(row, Column::kSpeed), truth.keys.speed, 5.1e-3);
    EXPECT_EQ(row.row[Column::kClass], truth.keys.type);
    EXPECT_NEAR(number(row, Column::kX), example.X_WT.x(), 5.1e-3);
    EXPECT_NEAR(std::cos(number(row, Column::kHeading) - example.X_WT.heading()), 1.0, 1e-8);
    classes += truth.action != 0 ? 1 : 0;

    std::string text;  // those of at least 0.01, the largest first
    Eigen::VectorXd left = truth.responsibilities;
    for (Eigen::Index action; left.maxCoeff(&action) >= 0.01; left[action] = 0.0) {
      absl::StrAppend(&text, text.empty() ? "" : " ", action, ":",
                      DecimalText(std::llround(left[action] * 1e4), 4));
    }
    EXPECT_EQ(row.responsibilities, text);
  }
  EXPECT_GT(classes, 0) << "all windows have one action: the test shows little";
}

// A description decodes the latent together with points around it.
TEST(TaggerTest, ARowHasTwoPointsOfTheMeanThatAnAnswerDescribes) {
  const auto model = SmallModel();
  const v1::Scenario recording = TownRecording();
  const v1::ExampleSettings settings = TaggingExamples(model->manifest(), 0.7);
  const std::vector<CsvRow> rows = Tagger(model, {settings, /*merged=*/false}).Tag(recording);
  const auto session = model->NewSession();
  scene::SceneReader reader(model->spec());
  scene::SceneInputs inputs = reader.NewInputs();
  const scene::RoadMap map = scene::RoadMap::Over(recording.map_features());
  std::vector<data::Example> examples =
      data::EnumerateExamples(recording, 0, model->spec(), settings);
  std::ranges::stable_sort(examples, {}, &data::Example::target_id);
  ASSERT_EQ(rows.size(), examples.size());
  for (size_t i = 0; i < rows.size(); ++i) {
    const CsvRow& row = rows[i];
    const data::Example& example = examples[i];
    const auto number = [&](Column column) { return ToNumber(column, row.row[column]); };
    reader.Read(recording, map, example.time, example.target_id, example.X_WT, &inputs);
    inference::SceneEncoding encoding;
    session->Encode(std::array{inference::ViewOf(inputs)}, std::span(&encoding, 1));
    const int action = static_cast<int>(row.row[Column::kAction]);
    const auto described =
        session->Describe(encoding, std::array{action}, inference::LatentSource::kPosterior);
    const auto mean = described[0].mean();
    const Eigen::Index middle = (mean.rows() - 1) / 2;
    EXPECT_NEAR(number(Column::kMidX), mean(middle, 0), 5.1e-3);
    EXPECT_NEAR(number(Column::kMidY), mean(middle, 1), 5.1e-3);
    EXPECT_NEAR(number(Column::kEndX), mean(mean.rows() - 1, 0), 5.1e-3);
    EXPECT_NEAR(number(Column::kEndY), mean(mean.rows() - 1, 1), 5.1e-3);
  }
}

TEST(TaggerTest, ARecordingHasTheSameRowsAfterOthers) {
  const auto model = SmallModel();
  const TaggerOptions options{TaggingExamples(model->manifest(), {}), true};
  const v1::Scenario recording = TownRecording();
  Tagger fresh(model, options);
  Tagger used(model, options);
  used.Tag(data::town::GenerateRecording({}, 1).scenario);
  const std::vector<CsvRow> expected = fresh.Tag(recording);
  const std::vector<CsvRow> rows = used.Tag(recording);
  ASSERT_EQ(rows.size(), expected.size());
  ASSERT_FALSE(rows.empty());
  for (size_t i = 0; i < rows.size(); ++i) {
    EXPECT_EQ(rows[i].row.values, expected[i].row.values);
    EXPECT_EQ(rows[i].responsibilities, expected[i].responsibilities);
  }
}

TEST(TaggerTest, ARecordingWithoutAWindowHasNoRows) {
  const auto model = SmallModel();
  Tagger tagger(model, {TaggingExamples(model->manifest(), {}), true});
  EXPECT_TRUE(tagger.Tag({}).empty());
}

// A dataset of two shards, one recording each, that have other names than ours.
void WriteDatasetOf(const std::filesystem::path& folder, const std::string& first,
                    const std::string& second) {
  auto writer = data::DatasetWriter::Create(folder, "a test", {.shard_bytes = 1});
  ASSERT_TRUE(writer.ok()) << writer.status();
  for (int i = 0; i < 2; ++i) {
    ASSERT_TRUE((*writer)->Add(data::town::GenerateRecording({}, i).scenario).ok());
  }
  ASSERT_TRUE((*writer)->Commit().ok());
  v1::Dataset manifest = *data::ReadDatasetManifest(folder);
  ASSERT_EQ(manifest.shards_size(), 2);
  for (int i = 0; i < 2; ++i) {
    const std::string& name = i == 0 ? first : second;
    std::filesystem::rename(folder / manifest.shards(i).file(), folder / name);
    manifest.mutable_shards(i)->set_file(name);
  }
  std::string json;
  ASSERT_TRUE(google::protobuf::util::MessageToJsonString(manifest, &json).ok());
  WriteBytes(folder / "dataset.json", json);
}

TEST(TagDatasetsTest, ShardsWithDotsInTheirNamesHaveFilesOfTheirOwn) {
  const TemporaryFolder folder;
  WriteDatasetOf(folder / "town", "part.1", "part.2");
  TaggingOptions options;
  options.datasets = {folder / "town"};
  options.output = folder / "tags";
  const auto summary = TagDatasets(SmallModel(), options);
  ASSERT_TRUE(summary.ok()) << summary.status();
  EXPECT_EQ(summary->shards, 2);
  const auto set = TagSet::Open({folder / "tags"});
  ASSERT_TRUE(set.ok()) << set.status();
  EXPECT_EQ(set->shards.size(), 2u);
  // Of two datasets, also names that become one.
  WriteDatasetOf(folder / "a", "b-x", "y");
  WriteDatasetOf(folder / "a-b", "x", "z");
  options.datasets = {folder / "a", folder / "a-b"};
  options.output = folder / "other";
  const auto refused = TagDatasets(SmallModel(), options);
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(refused.status().message()), testing::HasSubstr("called a-b-x"));
}

}  // namespace
}  // namespace maneuver::tags::tagger_test

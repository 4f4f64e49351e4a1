// Damage to any byte at rest is named, or changes nothing.

#include "tests/durability/corruption.h"

#include <gtest/gtest.h>
#include <sqlite3.h>

#include <fstream>
#include <iterator>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_folder.h"
#include "model/artifact/safetensors.h"
#include "model/data/dataset_folder.h"
#include "model/data/dataset_store.h"
#include "model/data/recording_index.h"
#include "server/serving/evaluation_files.h"
#include "server/store/sqlite_store.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::durability::corruption_test {
namespace {

namespace fs = std::filesystem;

absl::StatusOr<std::string> ReadModel(const fs::path& folder) {
  const auto model = artifact::ReadModelFolder(folder);
  if (!model.ok()) return model.status();
  return model->manifest.DebugString() + artifact::SerializeSafetensors(model->weights);
}

TEST(CorruptionTest, NoByteOfAModelFolderIsAlteredInSilence) {
  const TemporaryFolder parent;
  artifact::StoredModel model = artifact::TinyModel();
  for (int i = 0; i < 3; ++i) model.manifest.add_actions()->set_action_id(i);
  ASSERT_TRUE(artifact::WriteModelFolder(parent / "1", model).ok());
  ExpectNoSilentDamage(parent / "1", ReadModel);
}

TEST(CorruptionTest, NoByteOfAnEvaluationIsAlteredInSilence) {
  const TemporaryFolder parent;
  v1::EvaluationReport report;
  report.set_examples(7);
  (*report.mutable_metrics())["min_ade_6"] = 0.635;
  ASSERT_TRUE(serving::WriteEvaluation(parent.path(), "town", report).ok());
  ExpectNoSilentDamage(parent.path(), [](const fs::path& folder) -> absl::StatusOr<std::string> {
    const auto read = serving::ReadEvaluation(folder, "town");
    if (!read.ok()) return read.status();
    return read->ShortDebugString();
  });
}

v1::Scenario Recording(const std::string& id) {
  v1::Scenario scenario;
  scenario.set_scenario_id(id);
  scenario.set_prediction_time(0.5);
  scenario.add_target_ids(1);
  v1::Agent* const agent = scenario.add_agents();
  agent->set_id(1);
  agent->set_type(v1::AGENT_TYPE_VEHICLE);
  agent->set_length(4);
  agent->set_width(2);
  for (int step = 0; step < 10; ++step) {
    v1::AgentState* const state = agent->add_states();
    state->set_time(0.1 * step);
    state->set_x(step);
  }
  return scenario;
}

void WriteDataset(const fs::path& folder) {
  auto writer = data::DatasetWriter::Create(folder, "a test");
  ASSERT_TRUE(writer.ok()) << writer.status();
  for (const char* id : {"a", "b", "c"}) ASSERT_TRUE((*writer)->Add(Recording(id)).ok());
  v1::ManeuverAnnotation annotation;
  annotation.set_scenario_id("b");
  annotation.set_agent_id(1);
  annotation.set_maneuver("stop");
  ASSERT_TRUE((*writer)->Add(annotation).ok());
  ASSERT_TRUE((*writer)->Commit().ok());
}

// From front to back, as trainings and evaluations read it.
absl::StatusOr<std::string> ReadInOrder(const fs::path& folder) {
  const auto manifest = data::ReadDatasetManifest(folder);
  if (!manifest.ok()) return manifest.status();
  std::string all = manifest->SerializeAsString();
  absl::Status status = data::ForEachScenario(folder, data::OnDamage::kStop, [&](v1::Scenario&& s) {
    all += s.SerializeAsString();
    return true;
  });
  status.Update(
      data::ForEachAnnotation(folder, data::OnDamage::kStop, [&](v1::ManeuverAnnotation&& a) {
        all += a.SerializeAsString();
        return true;
      }));
  if (!status.ok()) return status;
  return all;
}

// Recording by recording, as windows of training and GetScenario do.
absl::StatusOr<std::string> ReadByIndex(const fs::path& folder) {
  const auto index = data::RecordingIndex::Open(folder);
  if (!index.ok()) return index.status();
  std::string all;
  for (size_t i = 0; i < index->entries().size(); ++i) {
    const auto recording = index->Read(i);
    if (!recording.ok()) return recording.status();
    absl::StrAppend(&all, index->Find(recording->scenario_id()), " ",
                    recording->SerializeAsString());
  }
  return all;
}

TEST(CorruptionTest, NoByteOfADatasetIsAlteredInSilence) {
  const TemporaryFolder parent;
  ASSERT_NO_FATAL_FAILURE(WriteDataset(parent / "town"));
  ASSERT_TRUE(data::RecordingIndex::Open(parent / "town").ok());
  ExpectNoSilentDamage(parent / "town", ReadInOrder);
  ExpectNoSilentDamage(parent / "town", ReadByIndex);
}

TEST(CorruptionTest, NoByteOfAKeptDescriptionIsAlteredInSilence) {
  const TemporaryFolder parent;
  ASSERT_NO_FATAL_FAILURE(WriteDataset(parent / "town"));
  const v1::ModelSpec spec = artifact::TinySpec();
  v1::ExampleSettings settings;
  settings.mutable_stride()->set_seconds(1);
  const ReadAll describe = [&](const fs::path& folder) -> absl::StatusOr<std::string> {
    const auto store = data::DatasetStore::Open(folder);
    if (!store.ok()) return store.status();
    const auto description = (*store)->Describe("town", spec, settings);
    if (!description.ok()) return description.status();
    return description->DebugString();
  };
  ASSERT_TRUE(describe(parent.path()).ok());  // keeps the description
  ExpectNoSilentDamage(parent.path(), describe);
}

v1::Job JobInState(const std::string& id, v1::JobState state) {
  v1::Job job;
  job.set_name("jobs/" + id);
  job.set_state(state);
  job.mutable_train()->set_model("models/town");
  job.mutable_create_time()->set_seconds(1000);
  return job;
}

absl::StatusOr<std::string> ReadStore(const fs::path& folder) {
  const auto store = store::SqliteStore::Open(folder / "maneuver.db");
  if (!store.ok()) return store.status();
  std::string all;
  const auto page = (*store)->List(100, "");
  if (!page.ok()) return page.status();
  if (!page->damaged.empty()) return page->damaged.front().error;
  for (const v1::Job& job : page->jobs) {
    absl::StrAppend(&all, job.DebugString());
    const auto events = (*store)->ListProgress(job.name(), 0, 100);
    if (!events.ok()) return events.status();
    for (const v1::JobProgress& event : *events) absl::StrAppend(&all, event.DebugString());
    const auto state = (*store)->ListInState(job.state(), std::nullopt);
    if (!state.ok()) return state.status();
    absl::StrAppend(&all, state->size(), "\n");
  }
  const auto requested = (*store)->FindRequest("request");
  if (!requested.ok()) return requested.status();
  if (*requested) {
    // With another digest, the server refuses to repeat the request.
    if ((*requested)->request_digest != "digest") {
      return absl::AlreadyExistsError("the request_id belongs to another request");
    }
    absl::StrAppend(&all, (*requested)->job.name());
  }
  const auto aliases = (*store)->ListAliases();
  if (!aliases.ok()) return aliases.status();
  for (const auto& alias : *aliases) absl::StrAppend(&all, alias.name.ToString(), alias.version);
  return all;
}

void FillStore(store::SqliteStore& store) {
  ASSERT_TRUE(store.Add(JobInState("first", v1::JOB_STATE_PENDING), "request", "digest").ok());
  ASSERT_TRUE(store.Add(JobInState("second", v1::JOB_STATE_PENDING), "", "").ok());
  const auto claimed = store.Claim([](v1::Job&) {});
  ASSERT_TRUE(claimed.ok() && *claimed) << claimed.status();
  for (int i = 1; i <= 3; ++i) {
    v1::JobProgress progress;
    progress.set_sequence(i);
    progress.set_phase("joint");
    ASSERT_TRUE(store.AddProgress((*claimed)->lease, progress).ok());
  }
  ASSERT_TRUE(store.SetAlias({"town", "serving"}, 3).ok());
  ASSERT_TRUE(store.SetAlias({"town", "candidate"}, 4).ok());
}

void WriteStore(const fs::path& file) {
  const auto store = store::SqliteStore::Open(file);
  ASSERT_TRUE(store.ok()) << store.status();
  FillStore(**store);
}

TEST(CorruptionTest, NoByteOfTheJobStoreIsAlteredInSilence) {
  const TemporaryFolder folder;
  ASSERT_NO_FATAL_FAILURE(WriteStore(folder / "maneuver.db"));
  ExpectNoSilentDamage(folder.path(), ReadStore);
}

// After a power cut, the store's journal is at rest as well.
TEST(CorruptionTest, NoByteOfTheJournalOfTheJobStoreIsAlteredInSilence) {
  const TemporaryFolder running;
  const auto store = store::SqliteStore::Open(running / "maneuver.db");
  ASSERT_TRUE(store.ok()) << store.status();
  ASSERT_NO_FATAL_FAILURE(FillStore(**store));
  const TemporaryFolder left;
  for (const char* file : {"maneuver.db", "maneuver.db-wal"}) {
    fs::copy_file(running / file, left / file);
  }
  ASSERT_GT(fs::file_size(left / "maneuver.db-wal"), 0u);
  ExpectNoSilentDamage(left.path(), ReadStore);
}

// Returns what a table and its indexes use of their pages: of each page the header with the places of
// the rows, and the rows. All fit in one page, a leaf.
std::vector<FilePart> UsedParts(const fs::path& file, const std::string& table) {
  sqlite3* database = nullptr;
  EXPECT_EQ(sqlite3_open(file.c_str(), &database), SQLITE_OK);
  sqlite3_stmt* pages = nullptr;
  EXPECT_EQ(sqlite3_prepare_v2(database,
                               "SELECT rootpage, (SELECT page_size FROM pragma_page_size) FROM "
                               "sqlite_schema WHERE tbl_name = ? AND rootpage > 0",
                               -1, &pages, nullptr),
            SQLITE_OK);
  sqlite3_bind_text(pages, 1, table.c_str(), -1, SQLITE_STATIC);
  std::ifstream stream(file, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(stream), {}};
  std::vector<FilePart> parts;
  while (sqlite3_step(pages) == SQLITE_ROW) {
    const auto page_size = static_cast<size_t>(sqlite3_column_int(pages, 1));
    const size_t page = static_cast<size_t>(sqlite3_column_int(pages, 0) - 1) * page_size;
    const auto number = [&](size_t at) {  // two bytes, the higher one first
      return size_t{static_cast<uint8_t>(bytes[page + at])} << 8 |
             static_cast<uint8_t>(bytes[page + at + 1]);
    };
    EXPECT_TRUE(bytes[page] == 13 || bytes[page] == 10) << "page " << page << " is no leaf";
    parts.push_back({file, page, page + 8 + 2 * number(3)});
    parts.push_back({file, page + number(5), page + page_size});
  }
  sqlite3_finalize(pages);
  sqlite3_close(database);
  return parts;
}

TEST(CorruptionTest, NoByteOfAJobIsAlteredInSilence) {
  const TemporaryFolder folder;
  ASSERT_NO_FATAL_FAILURE(WriteStore(folder / "maneuver.db"));
  const std::vector<FilePart> parts = UsedParts(folder / "maneuver.db", "jobs");
  ASSERT_EQ(parts.size(), 8u);  // a table and three indexes
  ExpectNoSilentDamage(folder.path(), ReadStore, {}, parts);
}

TEST(CorruptionTest, NoByteOfAnEventIsAlteredInSilence) {
  const TemporaryFolder folder;
  ASSERT_NO_FATAL_FAILURE(WriteStore(folder / "maneuver.db"));
  const std::vector<FilePart> parts = UsedParts(folder / "maneuver.db", "progress");
  ASSERT_EQ(parts.size(), 2u);  // a table that is its own index
  ExpectNoSilentDamage(folder.path(), ReadStore, {}, parts);
}

}  // namespace
}  // namespace maneuver::durability::corruption_test

// maneuver import, as it is called: order, damage, several threads.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "client/cli/command.h"
#include "client/cli/dataset_import.h"
#include "client/cli/maneuver.h"
#include "locks/mutex.h"
#include "model/data/dataset_folder.h"
#include "model/data/tfrecord.h"
#include "tests/unit/model/data/argoverse/argoverse_fixture.h"
#include "tests/unit/model/data/nuscenes/nuscenes_fixture.h"
#include "tests/unit/model/data/wire_format.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::cli::import_test {
namespace {

namespace fs = std::filesystem;
using data::Wire;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

struct Result {
  int status;
  std::string out;
  std::string err;
};

Result Maneuver(const std::vector<std::string>& arguments) {
  std::istringstream in;
  std::ostringstream out, err;
  Environment environment(in, out, err);
  const int status = RunManeuver(arguments, environment);
  return {status, out.str(), err.str()};
}

// A Waymo recording of one vehicle, three steps.
std::string WaymoRecording(const std::string& id) {
  Wire track = Wire().Varint(1, 1).Varint(2, 1);
  Wire recording;
  for (int i = 0; i < 3; ++i) {
    recording.Double(1, 0.1 * i);
    track.Message(3, Wire()
                         .Double(2, i)
                         .Double(3, 0.0)
                         .Float(5, 4.5F)
                         .Float(6, 2.0F)
                         .Float(8, 0.0F)
                         .Float(9, 10.0F)
                         .Float(10, 0.0F)
                         .Varint(11, 1));
  }
  return recording.Message(2, track).Bytes(5, id).Varint(10, 1).bytes();
}

std::string CommonRoadFile(const std::string& id) {
  return "<commonRoad benchmarkID=\"" + id +
         "\" commonRoadVersion=\"2020a\" timeStepSize=\"0.1\"><dynamicObstacle id=\"1\">"
         "<type>car</type><shape><rectangle><length>4</length><width>2</width></rectangle></shape>"
         "<initialState><position><point><x>0</x><y>0</y></point></position><orientation><exact>0"
         "</exact></orientation><time><exact>0</exact></time><velocity><exact>1</exact></velocity>"
         "</initialState></dynamicObstacle></commonRoad>";
}

class ImportTest : public testing::Test {
 protected:
  std::string Path(const std::string& name) const { return (folder_ / name).string(); }
  // The ids of a dataset's recordings, in their order.
  std::vector<std::string> Ids(const std::string& name) const {
    std::vector<std::string> ids;
    const auto status =
        data::ForEachScenario(folder_ / name, data::OnDamage::kStop, [&](v1::Scenario&& scenario) {
          ids.push_back(scenario.scenario_id());
          return true;
        });
    EXPECT_TRUE(status.ok()) << status;
    return ids;
  }
  void WriteWaymo(const std::string& name, const std::vector<std::string>& records) const {
    auto writer = data::TfRecordWriter::Create(folder_ / name);
    for (const std::string& record : records) EXPECT_TRUE((*writer)->Append(record).ok());
    EXPECT_TRUE((*writer)->Close().ok());
  }
  void Write(const std::string& name, const std::string& text) const {
    fs::create_directories((folder_ / name).parent_path());
    std::ofstream(folder_ / name, std::ios::binary) << text;
  }

  const TemporaryFolder folder_;
};

TEST_F(ImportTest, RecordingsKeepTheirOrderOnAnyNumberOfThreads) {
  std::vector<std::string> records, ids;
  for (int i = 0; i < 60; ++i)
    records.push_back(WaymoRecording(ids.emplace_back("r" + std::to_string(i))));
  WriteWaymo("a.tfrecord", records);
  for (const char* threads : {"1", "7"}) {
    const std::string out = std::string("of") + threads;
    const Result result =
        Maneuver({"import", "waymo", Path(out), Path("a.tfrecord"), "--threads", threads});
    ASSERT_EQ(result.status, kOk) << result.err;
    EXPECT_EQ(Ids(out), ids);
  }
  EXPECT_EQ(data::ReadDatasetManifest(folder_ / "of1")->shards(0).sha256(),
            data::ReadDatasetManifest(folder_ / "of7")->shards(0).sha256());
}

TEST_F(ImportTest, ParsesAtMostAsManyRecordingsAtOnceAsThereAreThreads) {
  Mutex mutex;
  CondVar changed;
  int parsing = 0;
  int most = 0;
  const auto parse = [&]() -> absl::StatusOr<v1::Scenario> {
    const MutexLock lock(mutex);
    most = std::max(most, ++parsing);
    changed.NotifyAll();
    // Gives one too many the time to come.
    const auto patience = std::chrono::steady_clock::now() + std::chrono::milliseconds(20);
    while (parsing < 3 && changed.WaitUntil(mutex, patience)) {
    }
    --parsing;
    return absl::InvalidArgumentError("nothing to see");
  };
  const ImportFormat format{"recording",
                            [](const std::vector<std::string>&) {
                              return std::vector<ImportFile>{{"recordings", 1.0}};
                            },
                            [&](const fs::path&, ImportSink& sink) {
                              absl::Status status;
                              for (int i = 0; i < 8 && status.ok(); ++i)
                                status = sink.Take({parse, "recording", 1.0});
                              return status;
                            }};
  std::istringstream in;
  std::ostringstream out, err;
  Environment environment(in, out, err);
  ImportArguments arguments;
  arguments.folder = Path("out");
  arguments.threads = 2;
  EXPECT_EQ(RunImport(arguments, format, environment), kFailed);
  EXPECT_THAT(err.str(), HasSubstr("unusable recordings skipped: 8"));
  const MutexLock lock(mutex);
  EXPECT_LE(most, 2);
}

TEST_F(ImportTest, ADamagedRecordStopsTheImportOrIsSkippedAndCounted) {
  WriteWaymo("a.tfrecord", {WaymoRecording("one"), WaymoRecording("two"), WaymoRecording("three")});
  {
    std::fstream file(folder_ / "a.tfrecord", std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(static_cast<std::streamoff>(WaymoRecording("one").size()) + 16 + 12 + 3);
    file.put('\x7f');  // one byte of the second record
  }
  const Result stopped = Maneuver({"import", "waymo", Path("stopped"), Path("a.tfrecord")});
  EXPECT_EQ(stopped.status, kFailed);
  EXPECT_THAT(stopped.err, HasSubstr("a.tfrecord"));
  EXPECT_FALSE(fs::exists(folder_ / "stopped"));
  const Result skipped =
      Maneuver({"import", "waymo", Path("skipped"), Path("a.tfrecord"), "--on-damage", "skip"});
  EXPECT_EQ(skipped.status, kFailed);
  EXPECT_THAT(skipped.err, HasSubstr("damaged records skipped: 1"));
  EXPECT_THAT(Ids("skipped"), ElementsAre("one", "three"));
}

TEST_F(ImportTest, RefusesARecordThatIsLongerThanAnyScenarioOfWaymo) {
  constexpr uint64_t kBytes = uint64_t{65} << 20;
  std::string record(reinterpret_cast<const char*>(&kBytes), sizeof kBytes);
  const uint32_t crc = data::MaskedCrc32c(record);
  record.append(reinterpret_cast<const char*>(&crc), sizeof crc);
  Write("a.tfrecord", record + WaymoRecording("long"));
  const Result result = Maneuver({"import", "waymo", Path("out"), Path("a.tfrecord")});
  EXPECT_EQ(result.status, kFailed);
  EXPECT_THAT(result.err, HasSubstr("the record claims 68157440 bytes, more than the 67108864"));
}

TEST_F(ImportTest, AnIdCannotControlTheTerminal) {
  WriteWaymo("a.tfrecord",
             {WaymoRecording("\x1b[2J" + std::string(200, 'i')), WaymoRecording("good")});
  const Result result = Maneuver({"import", "waymo", Path("out"), Path("a.tfrecord")});
  EXPECT_THAT(result.err, AllOf(HasSubstr("\\x1b[2Jii"), testing::Not(HasSubstr("\x1b"))));
  EXPECT_THAT(Ids("out"), ElementsAre("good"));
}

TEST_F(ImportTest, AnErrorReplacesTheProgressLine) {
  std::vector<std::string> records;
  records.reserve(6);
  for (int i = 0; i < 6; ++i) records.push_back(WaymoRecording("r" + std::to_string(i)));
  WriteWaymo("a.tfrecord", records);
  fs::resize_file(folder_ / "a.tfrecord", fs::file_size(folder_ / "a.tfrecord") - 1);
  std::istringstream in;
  std::ostringstream out, err;
  Environment environment(in, out, err);
  environment.interactive = true;
  EXPECT_EQ(RunManeuver({"import", "waymo", Path("out"), Path("a.tfrecord"), "--threads", "1"},
                        environment),
            kFailed);
  EXPECT_THAT(err.str(), AllOf(HasSubstr(" recordings, "), HasSubstr("\r\x1b[Kmaneuver: ")));
}

TEST_F(ImportTest, ImportsCommonRoadFilesByNameAndNamesUnusableOnes) {
  Write("scenes/b.xml", CommonRoadFile("second"));
  Write("scenes/a.xml", CommonRoadFile("first"));
  Write("scenes/c.xml", CommonRoadFile("second"));
  Write("scenes/d.xml", "<commonRoad commonRoadVersion=\"2017a\"/>");
  Write("scenes/README.md", "not read");
  const Result result = Maneuver({"import", "commonroad", Path("out"), Path("scenes")});
  EXPECT_EQ(result.status, kFailed);
  EXPECT_THAT(result.err, AllOf(HasSubstr("d.xml: commonRoadVersion \"2017a\""),
                                HasSubstr("unusable recordings skipped: 1"),
                                HasSubstr("1 recording with an id seen before")));
  EXPECT_THAT(result.out, HasSubstr("3 recordings"));
  EXPECT_THAT(Ids("out"), ElementsAre("first", "second", "second#2"));

  const Result strict =
      Maneuver({"import", "commonroad", Path("strict"), Path("scenes"), "--strict"});
  EXPECT_EQ(strict.status, kFailed);
  EXPECT_FALSE(fs::exists(folder_ / "strict"));
}

TEST_F(ImportTest, NoIdKeepsTheOtherRecordingsFromBeingImported) {
  const std::string longest(128, 'i');
  Write("scenes/1.xml", CommonRoadFile("x"));
  Write("scenes/2.xml", CommonRoadFile("x#2"));
  Write("scenes/3.xml", CommonRoadFile("x"));
  Write("scenes/4.xml", CommonRoadFile(longest));
  Write("scenes/5.xml", CommonRoadFile(longest));
  const Result result = Maneuver({"import", "commonroad", Path("out"), Path("scenes")});
  EXPECT_THAT(result.err, AllOf(HasSubstr("too long for a suffix"),
                                HasSubstr("unusable recordings skipped: 1")));
  EXPECT_THAT(Ids("out"), ElementsAre("x", "x#2", "x#3", longest));
}

TEST_F(ImportTest, SaysThatAFolderIsADatasetAlready) {
  Write("scenes/1.xml", CommonRoadFile("x"));
  ASSERT_EQ(Maneuver({"import", "commonroad", Path("out"), Path("scenes")}).status, kOk);
  const Result again = Maneuver({"import", "waymo", Path("again"), Path("out")});
  EXPECT_EQ(again.status, kUsage);
  EXPECT_THAT(again.err, HasSubstr("is a dataset already"));
}

TEST_F(ImportTest, ListsTheFirstProblemsAndCountsTheOthers) {
  for (int i = 100; i < 140; ++i) {
    Write("scenes/" + std::to_string(i) + ".xml", "no XML");
  }
  Write("scenes/good.xml", CommonRoadFile("good"));
  const Result result = Maneuver({"import", "commonroad", Path("out"), Path("scenes")});
  EXPECT_THAT(result.err, AllOf(HasSubstr("119.xml"), testing::Not(HasSubstr("120.xml")),
                                HasSubstr("unusable recordings skipped: 40")));
}

TEST_F(ImportTest, ImportsScenesOfNuScenesWithTheirMapOnAnyNumberOfThreads) {
  data::NuScenesFixture(5, 5).Write(folder_ / "nuscenes");
  for (const char* threads : {"1", "7"}) {
    const std::string out = std::string("of") + threads;
    const Result result =
        Maneuver({"import", "nuscenes", Path(out), Path("nuscenes"), "--threads", threads});
    ASSERT_EQ(result.status, kOk) << result.err;
    EXPECT_THAT(result.err, HasSubstr("toy-town.json: 1 links of connectivity"));
    EXPECT_THAT(Ids(out), ElementsAre("n001-a#scene-0001", "n001-a#scene-0002", "n001-b#scene-0003",
                                      "n001-b#scene-0004", "n001-c#scene-0005"));
  }
  EXPECT_EQ(data::ReadDatasetManifest(folder_ / "of1")->shards(0).sha256(),
            data::ReadDatasetManifest(folder_ / "of7")->shards(0).sha256());
  const auto scene = data::ReadScenario(folder_ / "of1", "n001-a#scene-0001");
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_GT(scene->map_features_size(), 10);
}

TEST_F(ImportTest, ADamagedSceneOfNuScenesIsLeftOutOrRefused) {
  data::NuScenesFixture fixture(2, 3);
  fixture.tables["sample_annotation"][0]["size"] = nullptr;
  fixture.Write(folder_ / "nuscenes");
  const std::string tables = Path("nuscenes/v1.0-mini");
  const Result left_out = Maneuver({"import", "nuscenes", Path("out"), tables});
  EXPECT_EQ(left_out.status, kFailed);
  EXPECT_THAT(left_out.err,
              HasSubstr("scene-0001: sample_annotation.json[0].size: must be 3 numbers"));
  EXPECT_THAT(Ids("out"), ElementsAre("n001-a#scene-0002"));
  EXPECT_EQ(Maneuver({"import", "nuscenes", Path("strict"), tables, "--strict"}).status, kFailed);
  EXPECT_FALSE(fs::exists(folder_ / "strict"));
}

TEST_F(ImportTest, ARowOfNuScenesThatBelongsToNoSceneStopsTheImportOrIsSkipped) {
  data::NuScenesFixture fixture(1, 3);
  fixture.tables["sample_annotation"][0]["sample_token"] = "nowhere";
  fixture.Row("instance", "scene-0001/car")["nbr_annotations"] = 2;
  fixture.Write(folder_ / "nuscenes");
  const Result stopped = Maneuver({"import", "nuscenes", Path("stopped"), Path("nuscenes")});
  EXPECT_EQ(stopped.status, kFailed);
  EXPECT_THAT(stopped.err, HasSubstr("sample_annotation.json[0].sample_token: names 'nowhere'"));
  EXPECT_FALSE(fs::exists(folder_ / "stopped"));
  const Result skipped =
      Maneuver({"import", "nuscenes", Path("out"), Path("nuscenes"), "--on-damage", "skip"});
  EXPECT_THAT(skipped.err, HasSubstr("damaged records skipped: 1"));
  EXPECT_THAT(Ids("out"), ElementsAre("n001-a#scene-0001"));
}

TEST_F(ImportTest, SaysWhereNuScenesLacksAFile) {
  data::NuScenesFixture(1, 3).Write(folder_ / "nuscenes");
  fs::remove_all(folder_ / "nuscenes" / "maps");
  const Result no_map = Maneuver({"import", "nuscenes", Path("out"), Path("nuscenes")});
  EXPECT_EQ(no_map.status, kFailed);
  EXPECT_THAT(no_map.err, AllOf(HasSubstr("maps/expansion/toy-town.json does not exist"),
                                HasSubstr("--maps none")));
  EXPECT_EQ(
      Maneuver({"import", "nuscenes", Path("bare"), Path("nuscenes"), "--maps", "none"}).status,
      kOk);
  data::NuScenesFixture(1, 3).Write(folder_ / "both");
  fs::copy(folder_ / "both" / "v1.0-mini", folder_ / "both" / "v1.0-test");
  EXPECT_THAT(Maneuver({"import", "nuscenes", Path("out"), Path("both")}).err,
              AllOf(HasSubstr("several sets of tables"), HasSubstr("v1.0-test")));
  fs::remove(folder_ / "nuscenes" / "v1.0-mini" / "log.json");
  EXPECT_THAT(Maneuver({"import", "nuscenes", Path("out"), Path("nuscenes")}).err,
              HasSubstr("log.json"));
  EXPECT_THAT(Maneuver({"import", "nuscenes", Path("out"), Path("nothing")}).err,
              HasSubstr("holds no scene.json"));
}

TEST_F(ImportTest, ImportsSequencesOfArgoverseWithTheirMap) {
  Write("train/data/2.csv", data::ArgoverseSequence(600.0 * 1000.0));
  Write("train/data/1.csv", data::ArgoverseSequence(600.0 * 1000.0 + 30.0));
  Write("train/data/3.csv", "TIMESTAMP,TRACK_ID,OBJECT_TYPE,X,Y,CITY_NAME\n0,a,AGENT,x,0,PIT\n");
  Write("map_files/pruned_argoverse_PIT_10314_vector_map.xml", data::ArgoverseMap());
  const Result result = Maneuver(
      {"import", "argoverse", Path("out"), Path("train/data"), "--maps", Path("map_files")});
  EXPECT_EQ(result.status, kFailed);
  EXPECT_THAT(result.err, AllOf(HasSubstr("3.csv: row 2: X 'x' is not a number"),
                                HasSubstr("1 links name lanes that the map lacks")));
  EXPECT_THAT(Ids("out"), ElementsAre("PIT-1000#1", "PIT-1000#2"));
  EXPECT_EQ(data::ReadScenario(folder_ / "out", "PIT-1000#1")->map_features_size(), 4);
  EXPECT_THAT(Maneuver({"import", "argoverse", Path("x"), Path("train/data")}).err,
              HasSubstr("--maps is required"));
  EXPECT_THAT(
      Maneuver({"import", "argoverse", Path("x"), Path("train/data"), "--maps", Path("train")}).err,
      HasSubstr("holds no pruned_argoverse_"));
  EXPECT_THAT(
      Maneuver({"import", "argoverse", Path("x"), Path("train/data"), "--maps", "none", "--strict"})
          .err,
      HasSubstr("3.csv: row 2"));
}

TEST_F(ImportTest, SaysThatThereIsNothingToImport) {
  Write("scenes/README.md", "no scenario");
  EXPECT_THAT(Maneuver({"import", "commonroad", Path("out"), Path("scenes")}).err,
              HasSubstr("holds no files to import"));
  EXPECT_THAT(Maneuver({"import", "commonroad", Path("out"), Path("nowhere")}).err,
              HasSubstr("nowhere does not exist"));
  EXPECT_THAT(Maneuver({"import", "commonroad", Path("out"), "/dev/null"}).err,
              HasSubstr("/dev/null is not a file"));
  Write("x.tfrecord", "this is no TFRecord file, though it is long enough for one");
  const Result wrong = Maneuver({"import", "waymo", Path("out"), Path("x.tfrecord")});
  EXPECT_EQ(wrong.status, kFailed);
  EXPECT_THAT(wrong.err, HasSubstr("x.tfrecord"));
  EXPECT_FALSE(fs::exists(folder_ / "out"));
}

}  // namespace
}  // namespace maneuver::cli::import_test

// maneuver import, as it is called: order, damage, several threads.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "client/cli/command.h"
#include "client/cli/maneuver.h"
#include "model/data/dataset_folder.h"
#include "model/data/tfrecord.h"
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
                                HasSubstr("1 recordings with an id seen before")));
  EXPECT_THAT(result.out, HasSubstr("3 recordings"));
  EXPECT_THAT(Ids("out"), ElementsAre("first", "second", "second#2"));

  const Result strict =
      Maneuver({"import", "commonroad", Path("strict"), Path("scenes"), "--strict"});
  EXPECT_EQ(strict.status, kFailed);
  EXPECT_FALSE(fs::exists(folder_ / "strict"));
}

TEST_F(ImportTest, SaysThatThereIsNothingToImport) {
  Write("scenes/README.md", "no scenario");
  EXPECT_THAT(Maneuver({"import", "commonroad", Path("out"), Path("scenes")}).err,
              HasSubstr("holds no files to import"));
  Write("x.tfrecord", "this is no TFRecord file, though it is long enough for one");
  const Result wrong = Maneuver({"import", "waymo", Path("out"), Path("x.tfrecord")});
  EXPECT_EQ(wrong.status, kFailed);
  EXPECT_THAT(wrong.err, HasSubstr("x.tfrecord"));
  EXPECT_FALSE(fs::exists(folder_ / "out"));
}

}  // namespace
}  // namespace maneuver::cli::import_test

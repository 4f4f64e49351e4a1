// A small synthetic dataset in the format of nuScenes: tables and a map expansion. No number of it
// comes from nuScenes.

#ifndef MANEUVER_TESTS_UNIT_MODEL_DATA_NUSCENES_NUSCENES_FIXTURE_H_
#define MANEUVER_TESTS_UNIT_MODEL_DATA_NUSCENES_NUSCENES_FIXTURE_H_

#include <cstdint>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

namespace maneuver::data {

// Scenes "scene-0001", "scene-0002" and so on, two of each drive "n001-a", "n001-b" and so on, all
// at "toy-town". In each, from its first sample on, one sample each half second:
//   car         along y = 0 at 10 m/s from x = 0
//   walker      along x = 20 at 1 m/s from y = -10
//   rider       a bicycle with a rider, along y = -3 at 4 m/s
//   bicycle     without a rider, stands at (30, -6)
//   barrier     stands at (40, -6); in the first sample alone
//   turner      a car that stands at (50, 10) and turns from 170 to 190 degrees and so on, by 20
//               degrees each sample
// The recording car's rear axle runs along y = 3.5 at 8 m/s, with a pose each 0.05 s.
struct NuScenesFixture {
  //   samples: of each scene
  explicit NuScenesFixture(int scenes = 1, int samples = 9);

  // Writes tables and map into `root`/v1.0-mini and `root`/maps/expansion.
  void Write(const std::filesystem::path& root) const;
  std::filesystem::path Tables(const std::filesystem::path& root) const {
    return root / "v1.0-mini";
  }

  // Returns the token of a name: 32 hexadecimal digits.
  static std::string Token(const std::string& name);
  // Returns the row of a table whose token is Token(name).
  nlohmann::json& Row(const std::string& table, const std::string& name);

  std::map<std::string, nlohmann::json> tables;  // by name
  // Lanes: "one" along y = 0 and "two" along y = 3.5, from x = 0 to 100; "three" along y = 7 the
  // other way; connector "left" from the end of "one" by an arc of 90 degrees and a radius of 10 m,
  // then 5 m straight; "up" from there, 20 m; connector "back" from the end of "up" to the
  // beginning of "one", so that the lanes have a cycle.
  nlohmann::json map;

 private:
  void AddInstance(const std::string& scene, const std::string& name, const std::string& category,
                   int annotations);
  void Annotate(const std::string& scene, int sample, const std::string& name, double x, double y,
                double heading, const std::string& attribute);
};

}  // namespace maneuver::data

#endif  // MANEUVER_TESTS_UNIT_MODEL_DATA_NUSCENES_NUSCENES_FIXTURE_H_

// Reads sequences of Argoverse 1 Motion Forecasting: one CSV file each.

#ifndef MANEUVER_MODEL_DATA_ARGOVERSE_ARGOVERSE_READER_H_
#define MANEUVER_MODEL_DATA_ARGOVERSE_ARGOVERSE_READER_H_

#include <map>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/data/city_map.h"

namespace maneuver::data {

// The maps of the cities, by CITY_NAME: PIT, MIA.
using CityMaps = std::map<std::string, CityMap>;

// Parses a sequence: rows of TIMESTAMP, TRACK_ID, OBJECT_TYPE, X, Y, CITY_NAME, in any order of
// rows, under a header that names the columns. `name` is the file's name without its extension.
// `maps` may be null: the scenario then has no map.
//
// Positions are kept. Times are counted from the first one. Derived:
//   - scenario_id: "PIT-526612#12345" of 12345.csv. The number in the middle counts blocks of ten
//     minutes, so sequences of one drive count as parts of one recording (recording_split.h).
//   - agent ids: 52 bits of a hash of TRACK_ID, the same in each sequence that the track is in.
//   - velocities: motion_fit.h.
//   - headings: the direction of the velocity, while that is at least 1 m/s and the agent moved
//     0.25 m that way in the last half second (at the beginning, in the next one). At other times,
//     the last such heading; before the first one, the first. An agent that never moves has the
//     heading of the nearest lane within 5 m, or 0. A car that reverses gets the opposite heading.
//   - types and sizes: AV and AGENT are vehicles of typical size, agent_size.h. OTHERS can be
//     anything, so their type stays unspecified; most are cars, and they get the size of one.
//   - prediction_time: the twentieth time, 1.9 s after the beginning, as in the benchmark; the last
//     time if there are fewer.
//   - target: the AGENT, if it has a row at that time.
//   - map: the surroundings of AV and AGENT.
//
// INVALID_ARGUMENT, with row and column, if a field is missing or out of range, the types are
// unknown, a track has two positions at one time, there are more tracks or rows of one than
// ScenarioLimits allow, the cities differ or have no map, or no track or several tracks are the
// AGENT.
absl::StatusOr<v1::Scenario> ParseArgoverse(std::string_view csv, const std::string& name,
                                            const CityMaps* maps);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_ARGOVERSE_ARGOVERSE_READER_H_

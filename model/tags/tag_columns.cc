#include "model/tags/tag_columns.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::tags {
namespace {

constexpr std::array<double, 7> kScales = {1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6};  // by decimals

double ScaleOf(Column column) { return kScales[static_cast<size_t>(SpecOf(column).decimals)]; }

}  // namespace

const std::array<ColumnSpec, kColumns>& Columns() {
  static const auto* const kSpecs = new std::array<ColumnSpec, kColumns>{{
      {"scene", "", 0, 4, "id of the recording: Scenario.scenario_id"},
      {"target", "", 0, 8, "id of the agent: Agent.id"},
      {"class", "", 0, 4, "type of the agent: vehicle, pedestrian, cyclist, other, unspecified"},
      {"from_time", "s", 3, 8, "prediction time of the first window, on the recording's clock"},
      {"to_time", "s", 3, 8, "prediction time of the last window"},
      {"windows", "", 0, 4, "number of windows in the row"},
      {"action", "", 0, 4, "the action: argmax of q(y|x,s)"},
      {"responsibility", "", 4, 4, "q(y|x,s) of the action, mean of the windows"},
      {"probability", "", 6, 4, "p(y|s) of the action, mean of the windows"},
      {"surprise", "nats", 4, 4,
       "-ln p(y|s) of the action, largest of the windows; p below 1e-30 counts as 1e-30"},
      {"peak_time", "s", 3, 8, "prediction time of the window with that surprise"},
      {"likeliest", "", 0, 4, "the action with the largest p(y|s), in the window at peak_time"},
      {"ade", "m", 2, 4,
       "mean distance of the likeliest action's mean from what was driven, mean of the windows"},
      {"fde", "m", 2, 4, "the same at the horizon"},
      {"speed", "m/s", 2, 4, "speed of the target at from_time"},
      {"x", "m", 2, 8, "position of the target at from_time, world frame"},
      {"y", "m", 2, 8, "position of the target at from_time, world frame"},
      {"heading", "rad", 4, 4, "heading of the target at from_time, world frame, -pi to pi"},
      {"mid_x", "m", 2, 4,
       "where the action's mean, decoded from E[z|y,s], leads after half of the horizon: metres "
       "ahead of where the target is at peak_time"},
      {"mid_y", "m", 2, 4, "the same, metres to its left"},
      {"end_x", "m", 2, 4, "the same at the horizon, metres ahead"},
      {"end_y", "m", 2, 4, "the same at the horizon, metres to its left"},
  }};
  return *kSpecs;
}

std::optional<Column> ColumnNamed(std::string_view name) {
  for (size_t i = 0; i < kColumns; ++i) {
    if (Columns()[i].name == name) return static_cast<Column>(i);
  }
  return std::nullopt;
}

int64_t ToInteger(Column column, double number) {
  const double scaled = std::round(number * ScaleOf(column));
  // 2^63 - 1 is not a double; the largest one below it will do.
  const bool narrow = SpecOf(column).bytes == 4;
  const double most = narrow ? std::numeric_limits<int32_t>::max() : 9223372036854774784.0;
  if (!(scaled > -most)) return static_cast<int64_t>(-most);
  return static_cast<int64_t>(std::min(scaled, most));
}

double ToNumber(Column column, int64_t integer) {
  return static_cast<double>(integer) / ScaleOf(column);
}

std::string DecimalText(int64_t integer, int decimals) {
  if (decimals == 0) return absl::StrCat(integer);
  const bool negative = integer < 0;
  const uint64_t magnitude = negative ? 0 - static_cast<uint64_t>(integer)  // also of the least one
                                      : static_cast<uint64_t>(integer);
  std::string digits = absl::StrCat(magnitude);
  const auto fraction = static_cast<size_t>(decimals);
  if (digits.size() <= fraction) digits.insert(0, fraction + 1 - digits.size(), '0');
  digits.insert(digits.size() - fraction, 1, '.');
  return negative ? "-" + digits : digits;
}

std::string ClassName(int64_t type) {
  constexpr std::string_view kPrefix = "AGENT_TYPE_";
  const bool known = type >= v1::AGENT_TYPE_UNSPECIFIED && type <= v1::AGENT_TYPE_OTHER;
  const std::string& name =
      v1::AgentType_Name(known ? static_cast<v1::AgentType>(type) : v1::AGENT_TYPE_UNSPECIFIED);
  return absl::AsciiStrToLower(name.substr(kPrefix.size()));
}

}  // namespace maneuver::tags

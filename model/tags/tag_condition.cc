#include "model/tags/tag_condition.h"

#include <cmath>
#include <string>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::tags {
namespace {

constexpr int64_t kLeast = std::numeric_limits<int64_t>::min() + 1;  // one less is in range
constexpr int64_t kMost = std::numeric_limits<int64_t>::max();
constexpr double kBeyond = 9e18;  // a larger double counts as the largest integer

// Returns the smallest integer whose number is at least, or greater than, `bound`.
int64_t FirstFrom(Column column, double bound, bool strict) {
  const double guess = std::floor(bound * std::pow(10.0, SpecOf(column).decimals));
  if (guess <= -kBeyond) return kLeast;
  if (guess >= kBeyond) return kMost;
  auto integer = static_cast<int64_t>(guess) - 1;
  while (strict ? ToNumber(column, integer) <= bound : ToNumber(column, integer) < bound) ++integer;
  return integer;
}

std::string ColumnNames() {
  std::vector<std::string> names;
  for (size_t i = 0; i < kColumns; ++i) {
    if (static_cast<Column>(i) != Column::kScene) names.push_back(Columns()[i].name);
  }
  return absl::StrJoin(names, ", ");
}

// What a column's integers are compared with.
struct Value {
  int64_t from;   // the smallest integer that is not less
  int64_t after;  // the smallest integer that is greater
};

absl::StatusOr<Value> ParseValue(Column column, const std::string& text) {
  if (column == Column::kClass) {
    for (int type = v1::AGENT_TYPE_UNSPECIFIED; type <= v1::AGENT_TYPE_OTHER; ++type) {
      if (ClassName(type) == text) return Value{type, type + 1};
    }
    return absl::InvalidArgumentError(absl::StrCat(
        "\"", text, "\" is not a class; give vehicle, pedestrian, cyclist, other or unspecified"));
  }
  // Not every integer beyond 2^53, such as an id, has a double.
  int64_t integer = 0;
  if (SpecOf(column).decimals == 0 && absl::SimpleAtoi(text, &integer) && integer >= kLeast &&
      integer < kMost) {
    return Value{integer, integer + 1};
  }
  double value = 0.0;
  if (absl::SimpleAtod(text, &value) && std::isfinite(value)) {
    return Value{FirstFrom(column, value, false), FirstFrom(column, value, true)};
  }
  return absl::InvalidArgumentError(absl::StrCat("\"", text, "\" is not a number"));
}

}  // namespace

Condition Between(Column column, double least, double most) {
  Condition condition{column};
  if (least > -HUGE_VAL) condition.least = FirstFrom(column, least, false);
  if (most < HUGE_VAL) condition.most = FirstFrom(column, most, true) - 1;
  return condition;
}

absl::StatusOr<Condition> ParseCondition(const std::string& text) {
  const size_t at = text.find_first_of("<>=!");
  if (at == std::string::npos) {
    return absl::InvalidArgumentError(
        absl::StrCat("\"", text, "\": give COLUMN OPERATOR VALUE, such as \"ade > 5\""));
  }
  size_t end = at + 1;
  if (end < text.size() && text[end] == '=') ++end;
  const std::string name(absl::StripAsciiWhitespace(text.substr(0, at)));
  const std::string sign = text.substr(at, end - at);
  const std::optional<Column> column = ColumnNamed(name);
  if (!column || *column == Column::kScene) {
    return absl::InvalidArgumentError(
        absl::StrCat("\"", name, "\" is not a column with numbers; there are ", ColumnNames()));
  }
  const absl::StatusOr<Value> value =
      ParseValue(*column, std::string(absl::StripAsciiWhitespace(text.substr(end))));
  if (!value.ok()) {
    return absl::InvalidArgumentError(absl::StrCat("\"", text, "\": ", value.status().message()));
  }
  Condition condition{*column};
  const auto [from, after] = *value;
  if (sign == ">=") condition.least = from;
  if (sign == ">") condition.least = after;
  if (sign == "<") condition.most = from - 1;
  if (sign == "<=") condition.most = after - 1;
  if (sign == "=" || sign == "==" || sign == "!=") {
    condition.least = from;
    condition.most = after - 1;
    condition.outside = sign == "!=";
  }
  if (sign == "!") {
    return absl::InvalidArgumentError(
        absl::StrCat("\"", text, "\": \"!\" is not an operator; there are <, <=, >, >=, = and !="));
  }
  return condition;
}

}  // namespace maneuver::tags

// The columns of tags. A tag says which action a target took for a while, and how the model judged
// it. docs/reference/formats.md describes the files.

#ifndef MANEUVER_MODEL_TAGS_TAG_COLUMNS_H_
#define MANEUVER_MODEL_TAGS_TAG_COLUMNS_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace maneuver::tags {

// The columns that are numbers, in the order of the table that Columns() returns.
enum class Column : int {
  kScene,  // number of the recording within its shard; the CSV has its id in place of it
  kTarget,
  kClass,  // v1::AgentType; the CSV has its name in place of it
  kFrom,
  kTo,
  kWindows,
  kAction,
  kResponsibility,
  kProbability,
  kSurprise,
  kPeak,
  kLikeliest,
  kAde,
  kFde,
  kSpeed,
  kX,
  kY,
  kHeading,
  kMidX,
  kMidY,
  kEndX,
  kEndY,
};
inline constexpr size_t kColumns = 22;

// A number is stored as an integer, in units of 10^-decimals. Text and binary files thus hold the
// same number, and a comparison has the same outcome in both.
struct ColumnSpec {
  std::string name;
  std::string unit;  // empty: a count or an id
  int decimals;
  int bytes;  // of the integer: 4 or 8
  std::string meaning;
};

const std::array<ColumnSpec, kColumns>& Columns();
inline const ColumnSpec& SpecOf(Column column) { return Columns()[static_cast<size_t>(column)]; }
// Returns the column of this name, or nothing.
std::optional<Column> ColumnNamed(std::string_view name);

// The numbers of one row, as integers.
struct TagRow {
  std::array<int64_t, kColumns> values{};

  int64_t& operator[](Column column) { return values[static_cast<size_t>(column)]; }
  int64_t operator[](Column column) const { return values[static_cast<size_t>(column)]; }
};

// Convert a number to the integer that stands for it, and back. ToInteger rounds to the nearest
// integer, clamps to the integer's range, and maps NaN to the lower end of the range.
int64_t ToInteger(Column column, double number);
double ToNumber(Column column, int64_t integer);

// Returns the decimal text of a number: "-0.25" for -25 with 2 decimals.
std::string DecimalText(int64_t integer, int decimals);

// Returns the lower-case name of an agent's type: "vehicle"; "unspecified" for numbers without one.
std::string ClassName(int64_t type);

}  // namespace maneuver::tags

#endif  // MANEUVER_MODEL_TAGS_TAG_COLUMNS_H_

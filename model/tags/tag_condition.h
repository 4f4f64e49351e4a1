// A condition on one column of tags.

#ifndef MANEUVER_MODEL_TAGS_TAG_CONDITION_H_
#define MANEUVER_MODEL_TAGS_TAG_CONDITION_H_

#include <cstdint>
#include <limits>
#include <string>

#include "absl/status/statusor.h"
#include "model/tags/tag_columns.h"

namespace maneuver::tags {

// Requires that the integer in a column lies in [least, most], or outside of it.
struct Condition {
  Column column = Column::kTarget;
  int64_t least = std::numeric_limits<int64_t>::min();
  int64_t most = std::numeric_limits<int64_t>::max();
  bool outside = false;
};

// Returns the condition that a number of the column lies between two bounds, both included.
// An infinite bound does not limit.
Condition Between(Column column, double least, double most);

// Parses "COLUMN OPERATOR VALUE", with <, <=, >, >=, = or !=, with or without spaces: "ade > 5",
// "class=pedestrian". A value may have more decimals than the column: it is not rounded.
// INVALID_ARGUMENT says what is wrong, and lists the columns if there is none of that name.
absl::StatusOr<Condition> ParseCondition(const std::string& text);

}  // namespace maneuver::tags

#endif  // MANEUVER_MODEL_TAGS_TAG_CONDITION_H_

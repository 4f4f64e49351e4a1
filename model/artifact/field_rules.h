// Checks rules for the fields of a message and collects violations.

#ifndef MANEUVER_MODEL_ARTIFACT_FIELD_RULES_H_
#define MANEUVER_MODEL_ARTIFACT_FIELD_RULES_H_

#include <google/protobuf/duration.pb.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/scene/duration.h"
#include "model/scene/field_violation.h"

namespace maneuver::artifact {

class FieldRules {
 public:
  // Limits the list: a message may have millions of invalid elements.
  static constexpr size_t kMaxViolations = 16;

  // Each rule returns whether it holds, and adds a violation if it does not.

  bool Require(bool holds, std::string field, std::string description) {
    if (holds) return true;
    if (violations_.size() < kMaxViolations) {
      violations_.push_back({std::move(field), std::move(description)});
    } else {
      ++violations_.back().others;
    }
    return false;
  }

  // Requires low <= value <= high; NaN fails. `quantity` names what is counted or measured.
  template <typename Number>
  bool Between(std::string field, const char* quantity, Number value, Number low, Number high) {
    return Require(value >= low && value <= high, std::move(field),
                   absl::StrCat(quantity, " must be ", low, " to ", high, ", not ", value));
  }

  // Requires a well-formed duration greater than zero and at most an hour.
  bool Positive(std::string field, const google::protobuf::Duration& duration) {
    const bool well_formed = duration.seconds() >= 0 && duration.nanos() >= 0 &&
                             duration.nanos() < 1'000'000'000 && duration.seconds() <= 3600;
    return Require(well_formed && scene::ToSeconds(duration) > 0, std::move(field),
                   "must be longer than 0 s and at most 3600 s");
  }

  // Adds the violations of a part of the message.
  //   prefix: put before each field
  void Include(const std::string& prefix, std::vector<scene::FieldViolation> part) {
    for (scene::FieldViolation& violation : part) {
      Require(false, prefix + violation.field, std::move(violation.description));
      violations_.back().others += violation.others;
    }
  }

  // Returns whether every rule held.
  bool all_hold() const { return violations_.empty(); }
  // Returns the first kMaxViolations. The last one has the number of the others.
  std::vector<scene::FieldViolation> violations() && { return std::move(violations_); }

 private:
  std::vector<scene::FieldViolation> violations_;
};

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_FIELD_RULES_H_

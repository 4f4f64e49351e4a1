#include "client/cli/load_arguments.h"

#include <cmath>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

namespace maneuver::cli {
namespace {

bool ParseNumber(absl::string_view text, double* value) {
  return absl::SimpleAtod(text, value) && std::isfinite(*value);
}

}  // namespace

absl::StatusOr<NumberRange> ParseRange(const std::string& flag, const std::string& text,
                                       double least, double most) {
  const std::vector<absl::string_view> ends = absl::StrSplit(text, absl::MaxSplits('-', 1));
  NumberRange range;
  if (ParseNumber(ends.front(), &range.least) && ParseNumber(ends.back(), &range.most) &&
      least <= range.least && range.least <= range.most && range.most <= most) {
    return range;
  }
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s %s: give a number or a range such as 1-5, from %.10g to %.10g", flag, text, least, most));
}

absl::StatusOr<NumberRange> ParseWholeRange(const std::string& flag, const std::string& text,
                                            int least, int most) {
  const auto range = ParseRange(flag, text, least, most);
  if (!range.ok()) return range;
  if (range->least == std::floor(range->least) && range->most == std::floor(range->most)) {
    return range;
  }
  return absl::InvalidArgumentError(
      absl::StrCat(flag, " ", text, ": give whole numbers, such as 3 or 1-5"));
}

absl::StatusOr<std::vector<SweepRate>> ParseRates(const std::string& text) {
  std::vector<SweepRate> rates;
  for (absl::string_view word : absl::StrSplit(text, ',')) {
    SweepRate rate;
    word = absl::StripAsciiWhitespace(word);
    rate.of_capacity = absl::ConsumeSuffix(&word, "%");
    if (!ParseNumber(word, &rate.value) || !(rate.value >= 1e-3 && rate.value <= 1e6)) {
      return absl::InvalidArgumentError(
          absl::StrCat("--rates ", text,
                       ": give calls a second or shares of the capacity, such as 25%,100%,200"));
    }
    if (rate.of_capacity) rate.value /= 100.0;
    rates.push_back(rate);
  }
  return rates;
}

std::string RateName(const SweepRate& rate) {
  return rate.of_capacity ? absl::StrCat(rate.value * 100.0, " %") : absl::StrCat(rate.value, "/s");
}

}  // namespace maneuver::cli

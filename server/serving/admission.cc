#include "server/serving/admission.h"

#include <algorithm>

#include "server/errors/error_details.h"

namespace maneuver::serving {

using std::chrono::nanoseconds;

// What is expected is not exact, and the answer has a way to go as well: of calls with less than
// that to spare most would be worked on for nothing. Where the queue has been there for longer than
// the call has left it is no burst, and does nobody any good: what waits has to stay in memory, and
// who is answered is answered late, by more than is known here if calls wait to be read as well. A
// short one keeps the workers as busy.
absl::Status CheckTimeLeft(const ExpectedWait& expected, nanoseconds left) {
  constexpr double kMargin = 1.25;
  constexpr double kStandingMargin = 3.0;
  constexpr nanoseconds kWay = std::chrono::milliseconds(3);
  const auto needed = std::chrono::duration_cast<nanoseconds>(
                          (expected.standing ? kStandingMargin : kMargin) * expected.wait +
                          kMargin * expected.work) +
                      kWay;
  if (needed <= left) return absl::OkStatus();
  return errors::WithRetryDelay(
      errors::WithReason(
          absl::ResourceExhaustedError("the server has more to do than it can before the call's "
                                       "deadline; try again a little later, or allow more time"),
          "DEADLINE_TOO_CLOSE"),
      RetryDelay(needed - left));
}

nanoseconds RetryDelay(nanoseconds delay) {
  return std::clamp<nanoseconds>(delay, std::chrono::milliseconds(1), std::chrono::seconds(30));
}

}  // namespace maneuver::serving

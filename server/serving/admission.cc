#include "server/serving/admission.h"

#include <algorithm>

#include "server/errors/error_details.h"

namespace maneuver::serving {

using std::chrono::nanoseconds;

// Two margins. The expected times are estimates, and the answer needs time to reach the caller.
// Without a margin, most calls that barely fit would miss their deadline after the work was done.
// A queue that has existed for longer than the call has left is not a burst, so it gets a larger
// margin. Such a queue costs memory and delays every answer, and calls that gRPC has not read yet
// add a delay that is unknown here. A shorter queue keeps the workers just as busy.
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

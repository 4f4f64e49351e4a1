// Decides whether a call is admitted: whether its caller is known, has a role for the method, and
// keeps to the rate limit. This happens before any resource is looked up, so a refused caller
// learns nothing about what exists.

#ifndef MANEUVER_SERVER_SECURITY_ACCESS_CONTROL_H_
#define MANEUVER_SERVER_SECURITY_ACCESS_CONTROL_H_

#include <filesystem>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "locks/mutex.h"
#include "server/monitoring/metrics.h"
#include "server/security/identities.h"
#include "server/security/rate_limiter.h"

namespace maneuver::security {

struct AccessOptions {
  std::filesystem::path identities;  // empty: anyone may do anything, unidentified
  double calls_per_second = 0.0;     // per client; 0: no limit
  double targets_per_second = 0.0;   // predicted targets per client; 0: no limit
};

// The credentials that a call presents. A token takes precedence over a certificate.
struct Credentials {
  std::vector<std::string> authorization = {};  // all headers of that name; two are never accepted
  // From the client's certificate, if it was verified.
  std::vector<std::string> alternative_names = {};
  std::string common_name = {};
  // Network address, without the port, as gRPC writes it: "ipv4:10.1.2.3",
  // "ipv6:%5B2001:db8::1%5D".
  std::string peer = {};
};

// Returns the network that an address belongs to: an IPv4 address alone, of IPv6 64 bits, which one
// subscriber has to himself: "ipv6:2001:db8::/64". Any other text as it is.
std::string NetworkOf(const std::string& peer);

// Thread-safe.
class AccessControl {
 public:
  // Reads the identities. Errors say what is wrong with the file.
  //   clock: tells when tokens expire.
  static absl::StatusOr<std::unique_ptr<AccessControl>> Create(
      const AccessOptions& options, monitoring::MetricRegistry& metrics,
      std::function<absl::Time()> clock = absl::Now);

  // Returns the name of the caller's identity; empty if it is unknown or identities are not used.
  std::string NameOf(const Credentials& credentials) const;

  // Admits a call, or returns an error with one of these reasons:
  //   UNAUTHENTICATED    CREDENTIALS_MISSING, TOKEN_UNKNOWN (also for an expired token; only the
  //                      log distinguishes the two)
  //   PERMISSION_DENIED  CERTIFICATE_NOT_LISTED, ROLE_MISSING, METHOD_NOT_DECLARED (roles.h)
  //   RESOURCE_EXHAUSTED RATE_LIMITED, with the delay; not for methods that anyone may call
  //   method: "/maneuver.v1.PredictionService/Predict", for example.
  absl::Status Admit(std::string_view method, const Credentials& credentials);

  // Admits `targets` more predicted targets for the caller of an admitted call. RATE_LIMITED as
  // above if that is too many; the errors of an unknown caller if the identities have changed
  // since.
  absl::Status AdmitTargets(const Credentials& credentials, int targets);
  bool limits_targets() const { return targets_.is_limited(); }

  // A long call, whose caller is checked again when the identities change. Destroying it ends the
  // checks, and waits for `on_refused` if that is running.
  class LongCall {
   public:
    virtual ~LongCall() = default;
  };
  // Watches a long call. Once its caller may no longer make it, each Reload calls `on_refused` with
  // the reason, on Reload's thread. `on_refused` must not destroy the object returned here. Returns
  // nullptr if identities are not used: nobody is refused then.
  [[nodiscard]] std::unique_ptr<LongCall> Watch(
      std::string_view method, Credentials credentials,
      std::function<void(const absl::Status&)> on_refused);

  // Reads the identities again and uses them for later calls. Returns false if they have not
  // changed. An error keeps the old ones. Refuses long calls whose token has expired.
  absl::StatusOr<bool> Reload();

  bool asks_for_identity() const { return !options_.identities.empty(); }

 private:
  // The caller, and the client that its calls are counted for.
  struct Caller {
    std::string client;
    std::string name;     // empty: unknown
    std::string expired;  // owner of the token, if it has expired; only for the log
  };

  AccessControl(const AccessOptions& options, monitoring::MetricRegistry& metrics,
                std::function<absl::Time()> clock);
  absl::Status Decide(std::string_view method, const Credentials& credentials, Caller& caller);
  absl::StatusOr<RoleSet> Identify(const Credentials& credentials, Caller& caller) const;
  // Counts and logs a refusal, and returns it.
  absl::Status Refuse(absl::Status refusal, std::string_view method, const Caller& caller);
  std::shared_ptr<const Identities> Current() const;
  absl::StatusOr<bool> ReadIdentities();
  void LookAtLongCalls(bool identities_changed) ABSL_LOCKS_EXCLUDED(long_calls_mutex_);

  const AccessOptions options_;
  const std::function<absl::Time()> clock_;
  RateLimiter calls_;
  RateLimiter targets_;
  RateLimiter log_lines_;
  std::map<std::string, monitoring::Counter*, std::less<>> refused_;  // by reason

  class ListedCall;
  Mutex long_calls_mutex_;
  std::list<ListedCall*> long_calls_ ABSL_GUARDED_BY(long_calls_mutex_);
  // Whether there are new long calls, or refused ones that have not ended.
  bool look_again_ ABSL_GUARDED_BY(long_calls_mutex_) = false;
  // When the expiry of tokens was last checked.
  absl::Time looked_at_ ABSL_GUARDED_BY(long_calls_mutex_);

  mutable Mutex mutex_;
  std::string text_ ABSL_GUARDED_BY(mutex_);  // of identities_
  std::shared_ptr<const Identities> identities_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace maneuver::security

#endif  // MANEUVER_SERVER_SECURITY_ACCESS_CONTROL_H_

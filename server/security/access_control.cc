#include "server/security/access_control.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <algorithm>
#include <array>
#include <optional>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "server/errors/error_details.h"
#include "server/monitoring/logging.h"
#include "server/security/secret_file.h"

namespace maneuver::security {
namespace {

constexpr std::string_view kCredentialsMissing = "CREDENTIALS_MISSING";
constexpr std::string_view kTokenUnknown = "TOKEN_UNKNOWN";
constexpr std::string_view kCertificateNotListed = "CERTIFICATE_NOT_LISTED";
constexpr std::string_view kRoleMissing = "ROLE_MISSING";
constexpr std::string_view kMethodNotDeclared = "METHOD_NOT_DECLARED";
constexpr std::string_view kRateLimited = "RATE_LIMITED";
constexpr std::array kReasons = {kCredentialsMissing, kTokenUnknown,      kCertificateNotListed,
                                 kRoleMissing,        kMethodNotDeclared, kRateLimited};

// Limits the log lines about refused calls, so that a flood of calls is not a flood of lines.
constexpr double kLogLinesPerSecond = 10.0;

// Returns what follows "Bearer ", in upper or lower case (RFC 9110, 11.1).
std::optional<std::string_view> BearerToken(std::string_view header) {
  constexpr std::string_view kScheme = "bearer ";
  if (!absl::StartsWithIgnoreCase(absl::string_view(header.data(), header.size()),
                                  absl::string_view(kScheme.data(), kScheme.size()))) {
    return std::nullopt;
  }
  return header.substr(kScheme.size());
}

absl::Status WithReason(absl::Status status, errors::Reason reason,
                        const std::map<std::string, std::string>& metadata = {}) {
  return errors::WithReason(std::move(status), reason, metadata);
}

absl::Status TooFast(const char* what, std::chrono::nanoseconds delay) {
  return errors::WithRetryDelay(
      WithReason(absl::ResourceExhaustedError(absl::StrCat(
                     "more ", what, " than this client may ask for in a second; slow down")),
                 kRateLimited),
      delay);
}

}  // namespace

std::string NetworkOf(const std::string& peer) {
  constexpr std::string_view kBegin = "ipv6:%5B";
  constexpr size_t kNetworkBytes = 8;
  if (!peer.starts_with(kBegin)) return peer;
  // "%" begins the end of the brackets, or a zone.
  const std::string text =
      peer.substr(kBegin.size(), peer.find('%', kBegin.size()) - kBegin.size());
  in6_addr address;
  if (inet_pton(AF_INET6, text.c_str(), &address) != 1) return peer;
  char network[INET6_ADDRSTRLEN];
  if (IN6_IS_ADDR_V4MAPPED(&address)) {
    inet_ntop(AF_INET, address.s6_addr + 12, network, sizeof network);
    return absl::StrCat("ipv4:", network);
  }
  std::fill(address.s6_addr + kNetworkBytes, std::end(address.s6_addr), uint8_t{0});
  inet_ntop(AF_INET6, &address, network, sizeof network);
  return absl::StrCat("ipv6:", network, "/64");
}

AccessControl::AccessControl(const AccessOptions& options, monitoring::MetricRegistry& metrics,
                             std::function<absl::Time()> clock)
    : options_(options),
      clock_(std::move(clock)),
      calls_(options.calls_per_second),
      targets_(options.targets_per_second),
      log_lines_(kLogLinesPerSecond),
      looked_at_(clock_()) {
  for (const std::string_view reason : kReasons) {
    refused_[std::string(reason)] = &metrics.AddCounter(
        "maneuver_refused_calls_total", "Calls that were refused before they began, by reason.",
        {{"reason", std::string(reason)}});
  }
}

absl::StatusOr<std::unique_ptr<AccessControl>> AccessControl::Create(
    const AccessOptions& options, monitoring::MetricRegistry& metrics,
    std::function<absl::Time()> clock) {
  std::unique_ptr<AccessControl> access(new AccessControl(options, metrics, std::move(clock)));
  if (const auto loaded = access->Reload(); !loaded.ok()) return loaded.status();
  return access;
}

class AccessControl::ListedCall final : public LongCall {
 public:
  ListedCall(AccessControl& access, std::string_view method, Credentials credentials,
             std::function<void(const absl::Status&)> on_refused)
      : access_(access),
        method_(method),
        credentials_(std::move(credentials)),
        on_refused_(std::move(on_refused)) {
    const MutexLock lock(access_.long_calls_mutex_);
    place_ = access_.long_calls_.insert(access_.long_calls_.end(), this);
    // Its caller may have been admitted by identities that have been replaced since.
    access_.look_again_ = true;
  }
  ~ListedCall() override {
    const MutexLock lock(access_.long_calls_mutex_);
    access_.long_calls_.erase(place_);
  }

  // Returns whether the caller may still make the call. Tells the call if not.
  bool Look() {
    Caller caller;
    absl::Status status = access_.Decide(method_, credentials_, caller);
    if (status.ok()) return true;
    if (!told_) status = access_.Refuse(std::move(status), method_, caller);
    told_ = true;
    on_refused_(status);
    return false;
  }

 private:
  AccessControl& access_;
  const std::string method_;
  const Credentials credentials_;
  const std::function<void(const absl::Status&)> on_refused_;
  bool told_ = false;
  std::list<ListedCall*>::iterator place_;
};

std::unique_ptr<AccessControl::LongCall> AccessControl::Watch(
    std::string_view method, Credentials credentials,
    std::function<void(const absl::Status&)> on_refused) {
  if (!asks_for_identity()) return nullptr;
  return std::make_unique<ListedCall>(*this, method, std::move(credentials), std::move(on_refused));
}

void AccessControl::LookAtLongCalls(bool identities_changed) {
  const MutexLock lock(long_calls_mutex_);
  const absl::Time now = clock_();
  const auto identities = Current();
  const bool expired = identities != nullptr && identities->AnyExpired(looked_at_, now);
  looked_at_ = now;
  if (!identities_changed && !expired && !look_again_) return;
  look_again_ = false;
  for (ListedCall* call : long_calls_) {
    if (!call->Look()) look_again_ = true;
  }
}

absl::StatusOr<bool> AccessControl::Reload() {
  auto changed = ReadIdentities();
  LookAtLongCalls(changed.ok() && *changed);
  return changed;
}

absl::StatusOr<bool> AccessControl::ReadIdentities() {
  if (!asks_for_identity()) return false;
  auto text = ReadSecretFile(options_.identities);
  if (!text.ok()) return text.status();
  {
    const MutexLock lock(mutex_);
    if (identities_ != nullptr && *text == text_) return false;
  }
  auto identities = Identities::Parse(*text);
  if (!identities.ok()) return identities.status();
  const MutexLock lock(mutex_);
  text_ = *std::move(text);
  identities_ = std::make_shared<const Identities>(*std::move(identities));
  return true;
}

std::shared_ptr<const Identities> AccessControl::Current() const {
  const MutexLock lock(mutex_);
  return identities_;
}

absl::StatusOr<RoleSet> AccessControl::Identify(const Credentials& credentials,
                                                Caller& caller) const {
  const auto identities = Current();
  const Identity* identity = nullptr;
  if (!credentials.authorization.empty()) {
    // An authorization header takes precedence over a certificate.
    const auto token = credentials.authorization.size() == 1
                           ? BearerToken(credentials.authorization.front())
                           : std::nullopt;
    if (token) identity = identities->FindToken(*token);
    if (identity != nullptr && identity->HasExpired(clock_())) {
      caller.expired = identity->name;
      identity = nullptr;
    }
    if (identity == nullptr) {
      return WithReason(absl::UnauthenticatedError(
                            "this token is not accepted here; ask the server's operator for one"),
                        kTokenUnknown);
    }
  } else if (!credentials.alternative_names.empty() || !credentials.common_name.empty()) {
    identity = identities->FindCertificate(credentials.alternative_names, credentials.common_name);
    if (identity == nullptr) {
      return WithReason(
          absl::PermissionDeniedError(
              "the server's operator has given this client certificate no role; ask for one"),
          kCertificateNotListed);
    }
  } else {
    return WithReason(absl::UnauthenticatedError(
                          "this server asks who calls; send the header authorization: Bearer TOKEN "
                          "(the command takes --token-file or MANEUVER_TOKEN)"),
                      kCredentialsMissing);
  }
  caller.name = identity->name;
  caller.client = absl::StrCat("name:", identity->name);
  return identity->roles;
}

std::string AccessControl::NameOf(const Credentials& credentials) const {
  Caller caller;
  if (asks_for_identity()) (void)Identify(credentials, caller);
  return caller.name;
}

absl::Status AccessControl::Decide(std::string_view method, const Credentials& credentials,
                                   Caller& caller) {
  caller.client = absl::StrCat("peer:", NetworkOf(credentials.peer));
  const std::optional<Role> needed = RequiredRole(method);
  std::optional<RoleSet> roles;
  if (asks_for_identity() && needed != Role::kAnyone) {
    auto known = Identify(credentials, caller);
    if (!known.ok()) return known.status();
    roles = *known;
  }
  if (!needed) {
    return WithReason(absl::PermissionDeniedError(
                          "this server has not declared who may make this call; report it"),
                      kMethodNotDeclared);
  }
  if (roles && !roles->Contains(*needed)) {
    const std::string role(ToString(*needed));
    return WithReason(absl::PermissionDeniedError(
                          absl::StrCat("this call needs the role ", role, ", which ", caller.name,
                                       " does not have; ask the server's operator for it")),
                      kRoleMissing, {{"role", role}});
  }
  return absl::OkStatus();
}

absl::Status AccessControl::Admit(std::string_view method, const Credentials& credentials) {
  Caller caller;
  absl::Status status = Decide(method, credentials, caller);
  // A balancer asks for the health of every server, from the address of many callers.
  if (status.ok() && RequiredRole(method) != Role::kAnyone) {
    if (const auto delay = calls_.Take(caller.client, 1.0)) status = TooFast("calls", *delay);
  }
  return status.ok() ? status : Refuse(std::move(status), method, caller);
}

absl::Status AccessControl::AdmitTargets(const Credentials& credentials, int targets) {
  if (!limits_targets()) return absl::OkStatus();
  Caller caller;
  caller.client = absl::StrCat("peer:", NetworkOf(credentials.peer));
  absl::Status status;
  if (asks_for_identity()) status = Identify(credentials, caller).status();
  if (status.ok()) {
    if (const auto delay = targets_.Take(caller.client, targets)) {
      status = TooFast("targets", *delay);
    }
  }
  return status.ok() ? status : Refuse(std::move(status), "targets", caller);
}

absl::Status AccessControl::Refuse(absl::Status refusal, std::string_view method,
                                   const Caller& caller) {
  const std::string reason = errors::ReasonOf(refusal);
  if (const auto counter = refused_.find(reason); counter != refused_.end()) {
    counter->second->Increment();
  }
  // Logs only names of existing methods, never text from the caller.
  if (!log_lines_.Take("", 1.0)) {
    const bool expired = !caller.expired.empty();
    const std::string logged_reason = expired ? "TOKEN_EXPIRED" : reason;
    const std::string client = expired ? absl::StrCat("name:", caller.expired) : caller.client;
    monitoring::Log(monitoring::LogLevel::kWarning, "call refused",
                    {{"method", method}, {"reason", logged_reason}, {"client", client}});
  }
  return refusal;
}

}  // namespace maneuver::security

#include "server/maneuverd/protection.h"

#include <chrono>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "server/monitoring/logging.h"
#include "server/rpc/server_credentials.h"

namespace maneuver {
namespace {

using monitoring::Log;
using monitoring::LogLevel;

constexpr std::chrono::seconds kReloadInterval{1};
constexpr int kWarnDays = 30;

absl::Status WithFlag(const char* flag, const absl::Status& status) {
  return {status.code(), absl::StrCat(flag, ": ", status.message())};
}

void WarnOfExposure(const ServerOptions& options) {
  if (security::IsLoopback(options.listen)) return;
  if (options.access.identities.empty()) {
    Log(LogLevel::kWarning,
        "no --tokens: anyone who reaches the port may predict, train and delete");
  } else if (!options.tls) {
    Log(LogLevel::kWarning, "no --tls-certificate: tokens cross the network in plain text");
  }
}

}  // namespace

absl::StatusOr<std::unique_ptr<Protection>> Protection::Open(const ServerOptions& options,
                                                             monitoring::MetricRegistry& metrics) {
  std::unique_ptr<Protection> protection(new Protection);
  std::vector<security::ReloadedFiles> files;
  if (options.tls) {
    auto store = security::CertificateStore::Open(*options.tls);
    if (!store.ok()) {
      return WithFlag(options.tls->client_ca.empty()
                          ? "--tls-certificate, --tls-key"
                          : "--tls-certificate, --tls-key, --tls-client-ca",
                      store.status());
    }
    protection->certificates_ = *std::move(store);
    protection->expiry_ = &metrics.AddGauge("maneuver_tls_certificate_expiry_timestamp_seconds",
                                            "When the server's certificate expires, Unix time.");
    protection->TellExpiry();
    files.push_back(
        {"certificates", [self = protection.get()] { return self->RenewCertificates(); }});
  }
  auto access = security::AccessControl::Create(options.access, metrics);
  if (!access.ok()) return WithFlag("--tokens", access.status());
  protection->access_ = *std::move(access);
  if (protection->access_->asks_for_identity()) {
    files.push_back({"tokens", [self = protection.get()] { return self->access_->Reload(); }});
  }
  WarnOfExposure(options);
  if (!files.empty()) {
    protection->reload_ =
        std::make_unique<security::PeriodicReload>(std::move(files), kReloadInterval);
  }
  return protection;
}

std::shared_ptr<grpc::ServerCredentials> Protection::credentials() const {
  return certificates_ == nullptr ? nullptr : rpc::ReloadingServerCredentials(certificates_);
}

absl::StatusOr<bool> Protection::RenewCertificates() {
  auto changed = certificates_->Reload();
  if (changed.ok() && *changed) TellExpiry();
  return changed;
}

void Protection::TellExpiry() {
  const auto expires = certificates_->Current()->expires;
  expiry_->Set(std::chrono::duration<double>(expires.time_since_epoch()).count());
  const int days = security::DaysUntil(expires, std::chrono::system_clock::now());
  if (days < 0) {
    Log(LogLevel::kWarning, "the server's certificate has expired: clients will refuse it",
        {{"days_left", days}});
  } else if (days < kWarnDays) {
    Log(LogLevel::kWarning, "the server's certificate expires soon: renew it",
        {{"days_left", days}});
  } else {
    Log(LogLevel::kInfo, "the server's certificate is valid", {{"days_left", days}});
  }
}

}  // namespace maneuver

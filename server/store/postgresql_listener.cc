#include "server/store/postgresql_listener.h"

#include <sys/eventfd.h>
#include <unistd.h>

#include <chrono>
#include <utility>

namespace maneuver::store {
namespace {

constexpr std::chrono::seconds kBetweenConnections{1};
// Every role that may connect to the database can NOTIFY, as often as it likes, and each change has
// queries as its consequence.
constexpr std::chrono::milliseconds kBetweenChanges{50};

}  // namespace

absl::Status NotifyOfModels(PostgresqlConnection& connection) {
  return connection.Run("NOTIFY maneuver_models").status();
}

PostgresqlListener::PostgresqlListener(std::string address, std::function<void()> changed,
                                       monitoring::Counter& heard)
    : address_(std::move(address)),
      changed_(std::move(changed)),
      heard_(heard),
      stop_event_(eventfd(0, EFD_CLOEXEC)) {
  thread_ = std::thread([this] {
    do Listen();
    while (!stop_.StoppedWithin(kBetweenConnections));
  });
}

PostgresqlListener::~PostgresqlListener() {
  stop_.Stop();
  eventfd_write(stop_event_, 1);
  thread_.join();
  close(stop_event_);
}

void PostgresqlListener::Listen() {
  // The store logs that the database is away.
  const auto connection = PostgresqlConnection::Open(address_);
  if (!connection.ok() || !(*connection)->RunScript("LISTEN maneuver_models").ok()) return;
  changed_();
  for (;;) {
    const auto is_notified = (*connection)->WaitForNotification(stop_event_);
    if (!is_notified.ok() || !*is_notified) return;
    heard_.Increment();
    changed_();
    if (stop_.StoppedWithin(kBetweenChanges)) return;
  }
}

}  // namespace maneuver::store

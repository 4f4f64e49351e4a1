// Hears from PostgreSQL when a server has changed aliases or versions. Private to the stores.

#ifndef MANEUVER_SERVER_STORE_POSTGRESQL_LISTENER_H_
#define MANEUVER_SERVER_STORE_POSTGRESQL_LISTENER_H_

#include <functional>
#include <string>
#include <thread>

#include "absl/status/status.h"
#include "locks/stop_latch.h"
#include "server/monitoring/metrics.h"
#include "server/store/postgresql_connection.h"
#include "server/store/store.h"

namespace maneuver::store {

// Tells the listeners of a store, once the transaction is committed, that it has changed models.
// Listeners of other stores in the same database hear it, too.
absl::Status NotifyOfModels(PostgresqlConnection& connection);

// Has a connection of its own, because that of the store runs one statement after the other.
// Connects again if the connection is lost.
class PostgresqlListener final : public StoreListener {
 public:
  //   changed: called at most twenty times a second; also when the listener has connected, because
  //     what came before is not told
  //   heard: counts notifications; must outlive this object
  PostgresqlListener(std::string address, std::function<void()> changed,
                     monitoring::Counter& heard);
  ~PostgresqlListener() override;
  PostgresqlListener(const PostgresqlListener&) = delete;
  PostgresqlListener& operator=(const PostgresqlListener&) = delete;

 private:
  // Returns when the connection is lost or the object is destroyed.
  void Listen();

  const std::string address_;
  const std::function<void()> changed_;
  monitoring::Counter& heard_;
  const int stop_event_;  // a descriptor that can be read once the object is destroyed
  StopLatch stop_;
  std::thread thread_;
};

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_POSTGRESQL_LISTENER_H_

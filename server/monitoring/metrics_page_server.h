// Private to monitoring/: the page of metrics over HTTP.

#ifndef MANEUVER_SERVER_MONITORING_METRICS_PAGE_SERVER_H_
#define MANEUVER_SERVER_MONITORING_METRICS_PAGE_SERVER_H_

#include <prometheus/collectable.h>
#include <prometheus/exposer.h>

#include <memory>
#include <string>

namespace maneuver::monitoring {

class MetricsPageServer {
 public:
  //   address: HOST:PORT; port 0 picks a free one.
  // Throws what prometheus::Exposer throws when it cannot listen there.
  explicit MetricsPageServer(const std::string& address);
  // Ends at once, though what listens looks only every two seconds for whether it is to end.
  ~MetricsPageServer();

  void Show(const std::weak_ptr<prometheus::Collectable>& collectable);
  int port() const { return port_; }

 private:
  const std::string host_;
  std::unique_ptr<prometheus::Exposer> exposer_;
  const int port_;
};

}  // namespace maneuver::monitoring

#endif  // MANEUVER_SERVER_MONITORING_METRICS_PAGE_SERVER_H_

// Metrics of the serving table.

#ifndef MANEUVER_SERVER_SERVING_SERVING_TABLE_METRICS_H_
#define MANEUVER_SERVER_SERVING_SERVING_TABLE_METRICS_H_

#include <map>
#include <set>
#include <string>

#include "server/monitoring/metrics.h"
#include "server/security/resource_name.h"

namespace maneuver::serving {

// Show and CountSwap need one caller at a time; the rest is safe to use from any thread.
class ServingTableMetrics {
 public:
  //   serves: whether this server keeps versions in memory. One that does not has no number of
  //   models that serve, which would be 0 for ever.
  ServingTableMetrics(monitoring::MetricRegistry& registry, bool serves);

  // Sets the number of versions in memory.
  void SetLoaded(size_t versions) { loaded_.Set(static_cast<double>(versions)); }
  void CountLoad(double seconds) { load_time_.Observe(seconds); }
  void CountFailedLoad() { failed_loads_.Increment(); }
  // Counts that an alias now points to another version.
  void CountSwap(const std::string& alias);
  // Shows the versions that `serving` and `candidate` of each model point to, for the first 32
  // models that have an alias.
  //   aliases: those whose versions are in memory.
  void Show(const std::map<security::ModelAliasName, int>& aliases);

 private:
  monitoring::MetricRegistry& registry_;
  monitoring::Gauge& loaded_;
  monitoring::Histogram& load_time_;
  monitoring::Counter& failed_loads_;
  monitoring::Gauge* serving_models_;                  // nullptr if there is none
  std::map<std::string, monitoring::Counter*> swaps_;  // by alias; "": any other
  std::set<std::string> models_;                       // that have gauges
  std::map<security::ModelAliasName, monitoring::Gauge*> versions_;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_SERVING_TABLE_METRICS_H_

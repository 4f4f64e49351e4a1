// Counters, gauges and histograms for the server's code. prometheus_metrics.h implements them. The
// null registry ignores everything.
//
// Thread-safe. A metric lives as long as its registry.

#ifndef MANEUVER_SERVER_MONITORING_METRICS_H_
#define MANEUVER_SERVER_MONITORING_METRICS_H_

#include <map>
#include <string>
#include <vector>

namespace maneuver::monitoring {

// A number that only grows.
class Counter {
 public:
  static Counter& Null();
  virtual ~Counter() = default;
  virtual void Increment(double amount = 1.0) = 0;
};

// A number that goes up and down.
class Gauge {
 public:
  static Gauge& Null();
  virtual ~Gauge() = default;
  virtual void Set(double value) = 0;
  virtual void Add(double amount) = 0;
};

// Counts observations in buckets.
class Histogram {
 public:
  static Histogram& Null();
  virtual ~Histogram() = default;
  virtual void Observe(double value) = 0;
};

// Labels must have few, fixed values: never values from a request.
using Labels = std::map<std::string, std::string>;

// Each class registers its metrics here once. The same name and labels give the same metric. Names
// follow Prometheus: maneuver_..., base units; counters end in _total.
class MetricRegistry {
 public:
  static MetricRegistry& Null();
  virtual ~MetricRegistry() = default;

  virtual Counter& AddCounter(const std::string& name, const std::string& help,
                              const Labels& labels = {}) = 0;
  virtual Gauge& AddGauge(const std::string& name, const std::string& help,
                          const Labels& labels = {}) = 0;
  //   buckets: upper bounds, increasing; an infinite last one is added
  virtual Histogram& AddHistogram(const std::string& name, const std::string& help,
                                  const std::vector<double>& buckets,
                                  const Labels& labels = {}) = 0;
};

// Returns upper bounds for times, seconds: 0.1 ms to 10 s, each about 2.2 times the one before.
std::vector<double> TimeBuckets();

}  // namespace maneuver::monitoring

#endif  // MANEUVER_SERVER_MONITORING_METRICS_H_

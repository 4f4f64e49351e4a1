// Counters, gauges and histograms as the server's code sees them. Prometheus is behind
// prometheus_metrics.h; without a registry everything counts into nothing.
//
// All of it is safe to use from any thread. A metric lives as long as its registry.

#ifndef MANEUVER_SERVER_MONITORING_METRICS_H_
#define MANEUVER_SERVER_MONITORING_METRICS_H_

#include <map>
#include <string>
#include <vector>

namespace maneuver::monitoring {

// Only grows.
class Counter {
 public:
  static Counter& Null();
  virtual ~Counter() = default;
  virtual void Increment(double amount = 1.0) = 0;
};

// Goes up and down.
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

// Values of labels must come from a small fixed set: never from a request.
using Labels = std::map<std::string, std::string>;

// Where each class registers its metrics once. The same name and labels give the same metric. Names
// follow Prometheus: maneuver_..., base units, counters end in _total.
class MetricRegistry {
 public:
  static MetricRegistry& Null();
  virtual ~MetricRegistry() = default;

  virtual Counter& AddCounter(const std::string& name, const std::string& help,
                              const Labels& labels = {}) = 0;
  virtual Gauge& AddGauge(const std::string& name, const std::string& help,
                          const Labels& labels = {}) = 0;
  //   buckets: upper bounds, increasing; the last, infinite one is added.
  virtual Histogram& AddHistogram(const std::string& name, const std::string& help,
                                  const std::vector<double>& buckets,
                                  const Labels& labels = {}) = 0;
};

// Upper bounds for times, seconds: 0.1 ms to 10 s, about 2.2 times apart.
std::vector<double> TimeBuckets();

}  // namespace maneuver::monitoring

#endif  // MANEUVER_SERVER_MONITORING_METRICS_H_

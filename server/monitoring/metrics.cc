#include "server/monitoring/metrics.h"

namespace maneuver::monitoring {
namespace {

class NullCounter final : public Counter {
 public:
  void Increment(double) override {}
};

class NullGauge final : public Gauge {
 public:
  void Set(double) override {}
  void Add(double) override {}
};

class NullHistogram final : public Histogram {
 public:
  void Observe(double) override {}
};

class NullRegistry final : public MetricRegistry {
 public:
  Counter& AddCounter(const std::string&, const std::string&, const Labels&) override {
    return Counter::Null();
  }
  Gauge& AddGauge(const std::string&, const std::string&, const Labels&) override {
    return Gauge::Null();
  }
  Histogram& AddHistogram(const std::string&, const std::string&, const std::vector<double>&,
                          const Labels&) override {
    return Histogram::Null();
  }
};

}  // namespace

Counter& Counter::Null() {
  static NullCounter counter;
  return counter;
}

Gauge& Gauge::Null() {
  static NullGauge gauge;
  return gauge;
}

Histogram& Histogram::Null() {
  static NullHistogram histogram;
  return histogram;
}

MetricRegistry& MetricRegistry::Null() {
  static NullRegistry registry;
  return registry;
}

std::vector<double> TimeBuckets() {
  return {0.0001, 0.00025, 0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025,
          0.05,   0.1,     0.25,   0.5,   1.0,    2.5,   5.0,  10.0};
}

}  // namespace maneuver::monitoring

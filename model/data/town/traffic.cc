#include "model/data/town/traffic.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "model/data/town/lane_change.h"
#include "model/data/town/leader.h"
#include "model/data/town/right_of_way.h"

namespace maneuver::data::town {
namespace {

constexpr double kUnlimited = std::numeric_limits<double>::infinity();
constexpr double kLongestStep = 0.1;     // seconds
constexpr double kHardestBraking = 5.5;  // metres per second squared
constexpr int kFirstPedestrian = 1000;

class Traffic {
 public:
  Traffic(const Place& place, Random& random)
      : place_(place), random_(random), walkers_(place, random, kFirstPedestrian) {
    due_.assign(place.sources.size(), -1e9);
    AddParked();
    AddInitial();
  }

  void Step(double time, double dt) {
    for (Vehicle& vehicle : vehicles_) LookAhead(place_.graph, vehicle);
    for (size_t i = 0; i < vehicles_.size(); ++i) Decide(i, time, dt);
    for (size_t i = 0; i < vehicles_.size(); ++i) {
      if (!Advance(place_.graph, dt, vehicles_[i])) gone_.push_back(vehicles_[i].id);
    }
    walkers_.Step(time, dt, vehicles_);
    for (const int id : gone_) {
      const auto leaver = std::find_if(vehicles_.begin(), vehicles_.end(),
                                       [id](const Vehicle& vehicle) { return vehicle.id == id; });
      Keep(*leaver);
      vehicles_.erase(leaver);
    }
    gone_.clear();
    Spawn(time + dt);
  }

  void Record(double time) {
    for (const Vehicle& vehicle : vehicles_) {
      Track& track = tracks_[vehicle.id];
      if (track.points.empty()) {
        track.id = vehicle.id;
        track.kind = vehicle.kind;
        track.length = vehicle.length;
        track.width = vehicle.width;
      }
      track.points.push_back({.time = time,
                              .p = vehicle.pose.p,
                              .heading = vehicle.body_heading,
                              .velocity = vehicle.speed * Direction(vehicle.pose.heading),
                              .speed = vehicle.speed,
                              .travelled = vehicle.travelled,
                              .path_heading = vehicle.pose.heading,
                              .lateral = vehicle.lateral,
                              .lane = vehicle.lane()});
    }
    for (const Pedestrian& walker : walkers_.all()) {
      Track& track = tracks_[walker.id];
      track.id = walker.id;
      track.kind = RoadUser::kPedestrian;
      track.length = 0.6;
      track.width = 0.6;
      track.points.push_back({.time = time,
                              .p = walker.p,
                              .heading = walker.heading,
                              .velocity = walker.speed * Direction(walker.heading),
                              .speed = walker.speed,
                              .travelled = walker.s,
                              .path_heading = walker.heading});
    }
  }

  void RecordParked(double time) {
    for (size_t i = 0; i < parked_.size(); ++i) {
      tracks_[parked_[i]].points.push_back({.time = time,
                                            .p = parked_poses_[i].p,
                                            .heading = parked_poses_[i].heading,
                                            .path_heading = parked_poses_[i].heading});
    }
  }

  std::vector<Track> Done() {
    for (const Vehicle& vehicle : vehicles_) Keep(vehicle);
    std::vector<Track> result;
    for (auto& [id, track] : tracks_) {
      if (track.points.size() >= 2) result.push_back(std::move(track));
    }
    return result;
  }

 private:
  void Keep(const Vehicle& vehicle) {
    const auto track = tracks_.find(vehicle.id);
    if (track != tracks_.end()) track->second.events = vehicle.events;
  }

  // Returns an id that no pedestrian has.
  int NewId() {
    if (next_id_ == kFirstPedestrian) next_id_ += place_.walkers;
    return next_id_++;
  }

  Vehicle NewVehicle(int lane) {
    Vehicle vehicle;
    vehicle.id = NewId();
    if (place_.graph.lanes[lane].kind == LaneKind::kBike) {
      vehicle.kind = RoadUser::kCyclist;
      vehicle.length = random_.Uniform(1.65, 1.9);
      vehicle.width = random_.Uniform(0.55, 0.75);
      vehicle.driver = DrawCyclist(random_);
    } else {
      vehicle.driver = DrawDriver(random_);
      vehicle.length = random_.ClampedNormal(4.65, 0.35, 3.6, 5.6);
      vehicle.width = random_.ClampedNormal(1.88, 0.09, 1.65, 2.1);
    }
    vehicle.wishes_at = random_.Exponential(1.0 / place_.lane_change_rate) - 10.0;
    return vehicle;
  }

  // Turns a car into a van, bus or lorry, unless its route has a tight turn.
  void MaybeLengthen(Vehicle& vehicle) {
    if (vehicle.kind != RoadUser::kVehicle || !random_.Chance(place_.long_vehicle_share)) return;
    const bool turns =
        std::any_of(vehicle.route.begin(), vehicle.route.end(), [this](const RouteStep& step) {
          const Movement movement = place_.graph.lanes[step.lane].movement;
          return movement != Movement::kAlong && movement != Movement::kStraight;
        });
    if (turns) return;
    vehicle.length = random_.Uniform(6.0, 12.0);
    vehicle.width = random_.Uniform(2.2, 2.5);
    vehicle.driver.acceleration *= 0.6;
    vehicle.driver.speed_factor = std::min(0.9, vehicle.driver.speed_factor);
    vehicle.driver.offset *= 0.4;
    vehicle.driver.wander *= 0.6;
  }

  void AddParked() {
    for (const ParkedVehicle& parked : place_.parked) {
      if (parked.bay_lane >= 0) {
        Vehicle vehicle = NewVehicle(parked.bay_lane);
        vehicle.length = parked.length;
        vehicle.width = parked.width;
        vehicle.route = DrawRoute(place_.graph, parked.bay_lane, 0.0, random_);
        vehicle.leaves_at = parked.leaves_after;
        SetPose(place_.graph, true, vehicle);
        const double way = place_.graph.lanes[parked.bay_lane].path.length();
        vehicle.events.push_back({Maneuver::kParkOut, -1.0, -1.0, way + 6.0});
        vehicles_.push_back(std::move(vehicle));
        continue;
      }
      const int id = NewId();
      Track& track = tracks_[id];
      track.id = id;
      track.length = parked.length;
      track.width = parked.width;
      parked_.push_back(track.id);
      parked_poses_.push_back(parked.pose);
    }
  }

  void AddInitial() {
    std::vector<double> weights;
    for (const Lane& lane : place_.graph.lanes) {
      const bool open = lane.kind == LaneKind::kRoad && !lane.ends;
      weights.push_back(open ? lane.path.length() : 0.0);
    }
    for (int i = 0; i < place_.initial_vehicles; ++i) {
      const int lane = random_.Choose(weights);
      const Lane& on = place_.graph.lanes[lane];
      const double s = random_.Uniform(4.0, std::max(5.0, on.path.length() - 15.0));
      const Vec2 p = on.path.At(s).p;
      const double room = 10.0 + on.speed_limit;
      const bool taken = std::any_of(vehicles_.begin(), vehicles_.end(), [&](const Vehicle& other) {
        return other.lane() == lane && Norm(other.pose.p - p) < room;
      });
      if (taken) continue;
      Vehicle vehicle = NewVehicle(lane);
      vehicle.route = DrawRoute(place_.graph, lane, 0.0, random_);
      vehicle.s = s;
      const double far = on.path.length() - s;
      vehicle.speed = std::min(0.8 * on.speed_limit * vehicle.driver.speed_factor,
                               on.next.empty() ? kUnlimited : std::sqrt(2.0 * far));
      MaybeLengthen(vehicle);
      SetPose(place_.graph, true, vehicle);
      vehicles_.push_back(std::move(vehicle));
    }
  }

  void Spawn(double time) {
    for (size_t i = 0; i < place_.sources.size(); ++i) {
      const Source& source = place_.sources[i];
      if (due_[i] < -1e8) due_[i] = time + random_.Exponential(source.mean_headway);
      if (time < due_[i]) continue;
      const Lane& lane = place_.graph.lanes[source.lane];
      Vehicle vehicle = NewVehicle(source.lane);
      double speed = lane.speed_limit * vehicle.driver.speed_factor;
      double room = kUnlimited;
      const PathPoint start = lane.path.At(0.0);
      for (const Vehicle& other : vehicles_) {
        const Vec2 d = other.pose.p - start.p;
        const double along = Dot(d, Direction(start.heading));
        if (along < -15.0 || along > 150.0) continue;
        if (other.lane() != source.lane && std::abs(Cross(Direction(start.heading), d)) > 2.2)
          continue;
        const double gap = along - 0.5 * other.length - 0.5 * vehicle.length;
        // Sets the speed as if it had been slowing down for the vehicle ahead all along.
        const double spare = std::max(0.0, gap - 10.0 - 0.8 * other.speed);
        speed = std::min(speed, std::sqrt(other.speed * other.speed + 2.4 * spare));
        room = std::min(room, gap);
      }
      if (room < 6.0 + 1.2 * speed) continue;
      due_[i] = time + random_.Exponential(source.mean_headway);
      vehicle.speed = speed;
      vehicle.route = DrawRoute(place_.graph, source.lane, 0.0, random_);
      MaybeLengthen(vehicle);
      SetPose(place_.graph, true, vehicle);
      vehicles_.push_back(std::move(vehicle));
    }
  }

  // Returns the acceleration that stops smoothly after `distance` metres; infinity if no braking is
  // needed yet.
  static double StopWithin(const Vehicle& vehicle, double distance) {
    const double v = vehicle.speed;
    if (distance <= 0.15) return v > 0.0 ? -3.0 : -0.5;
    const double needed = v * v / (2.0 * distance);
    if (needed > 0.9 * vehicle.driver.braking) return -needed * 1.03;
    // Allows no more speed than it can shed comfortably.
    const double allowed = std::sqrt(2.0 * 0.9 * vehicle.driver.braking * distance);
    return 1.5 * (allowed - v);
  }

  double GateAcceleration(size_t index, double time) {
    Vehicle& vehicle = vehicles_[index];
    for (size_t step = vehicle.step + 1; step < vehicle.route.size(); ++step) {
      const Lane& lane = place_.graph.lanes[vehicle.route[step].lane];
      if (place_.graph.lanes[vehicle.route[step - 1].lane].reverse) {
        // It leaves a bay backwards and stops before it drives forwards.
        const double left = DistanceToStep(place_.graph, vehicle, step);
        if (vehicle.speed > 0.1 || left > 0.4) return StopWithin(vehicle, left - 0.1);
        return kUnlimited;
      }
      const double distance = DistanceToGate(place_.graph, vehicle, step);
      const double look = 8.0 + vehicle.speed +
                          vehicle.speed * vehicle.speed / (2.0 * 0.9 * vehicle.driver.braking);
      if (distance > look) return kUnlimited;
      if (!lane.gate) continue;
      if (vehicle.admitted >= step) {
        if (!MustStopAfterAll(place_, vehicle, step, time)) continue;
        vehicle.admitted = step - 1;
        return StopWithin(vehicle, distance);
      }
      if (vehicle.speed < 0.3 && distance < 3.0) {
        vehicle.stood_at = std::min(vehicle.stood_at, time);
      }
      const bool free =
          lane.gate->kind == GateKind::kSignal || lane.gate->kind == GateKind::kPriority;
      if ((free || distance < 14.0) &&
          MayEnter(place_, vehicles_, walkers_.all(), vehicle, step, time)) {
        vehicle.admitted = step;
        continue;
      }
      return StopWithin(vehicle, distance);
    }
    return kUnlimited;
  }

  void Decide(size_t index, double time, double dt) {
    Vehicle& vehicle = vehicles_[index];
    const Lane& lane = place_.graph.lanes[vehicle.lane()];
    if (lane.kind == LaneKind::kBay && vehicle.travelled == 0.0 && vehicle.speed == 0.0) {
      // It is still parked. The gate of a bay is its own start.
      if (time < vehicle.leaves_at) return;
      if (vehicle.admitted == 0) {
        if (!MayEnter(place_, vehicles_, walkers_.all(), vehicle, 0, time)) return;
        vehicle.admitted = 1;
      }
    }
    const Leader leader = FindLeader(vehicles_, walkers_.all(), vehicle);
    double desired = lane.speed_limit * vehicle.driver.speed_factor;
    for (const AheadPoint& point : vehicle.ahead) {
      desired = std::min(
          desired, std::sqrt(point.speed_limit * point.speed_limit + 2.0 * 1.3 * point.distance));
    }
    double wanted = IdmAcceleration(vehicle.driver, vehicle.speed, std::max(0.5, desired),
                                    leader.gap, leader.speed);
    if (vehicle.speed > desired) wanted = std::min(wanted, -1.2 * (vehicle.speed - desired));
    wanted = std::min(wanted, GateAcceleration(index, time));
    if (lane.ends) {
      wanted = std::min(wanted, StopWithin(vehicle, lane.path.length() - vehicle.s - 8.0));
    }
    wanted = std::clamp(wanted, -kHardestBraking, vehicle.driver.acceleration);
    // Drivers change acceleration at a finite rate, and faster in an emergency.
    const double rate = wanted < -3.5 ? 40.0 : wanted < vehicle.acceleration ? 8.0 : 3.5;
    const double most = rate * dt;
    vehicle.acceleration += std::clamp(wanted - vehicle.acceleration, -most, most);
    if (vehicle.speed <= 0.0 && wanted <= 0.0) vehicle.acceleration = 0.0;
    if (vehicle.kind == RoadUser::kVehicle) {
      ConsiderLaneChange(place_.graph, vehicles_, time, place_.lane_change_rate, leader.gap,
                         leader.speed, random_, vehicle);
    }
  }

  const Place& place_;
  Random& random_;
  Pedestrians walkers_;
  std::vector<Vehicle> vehicles_;
  std::vector<double> due_;  // time of each source's next arrival
  std::vector<int> gone_;
  std::vector<int> parked_;
  std::vector<PathPoint> parked_poses_;
  std::map<int, Track> tracks_;
  int next_id_ = 1;
};

}  // namespace

std::vector<Track> SimulateTraffic(const Place& place, const TrafficOptions& options,
                                   Random& random) {
  Traffic traffic(place, random);
  const int substeps =
      std::max(1, static_cast<int>(std::ceil(options.frame_interval / kLongestStep - 1e-9)));
  const double dt = options.frame_interval / substeps;
  const int warm_up = static_cast<int>(std::ceil(place.warm_up / dt));
  const int frames = static_cast<int>(std::floor(options.duration / options.frame_interval + 1e-9));
  for (int i = 0; i < warm_up; ++i) traffic.Step((i - warm_up) * dt, dt);
  for (int frame = 0; frame <= frames; ++frame) {
    const double time = frame * options.frame_interval;
    traffic.Record(time);
    traffic.RecordParked(time);
    for (int k = 0; k < substeps; ++k) traffic.Step(time + k * dt, dt);
  }
  return traffic.Done();
}

}  // namespace maneuver::data::town

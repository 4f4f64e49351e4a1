#include "model/data/commonroad/commonroad_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "model/scene/scenario_validation.h"

namespace maneuver::data::commonroad_reader_test {
namespace {

using testing::HasSubstr;

std::string State(const std::string& tag, int step, double x, double y, double heading,
                  double speed) {
  const auto exact = [](const char* name, double value) {
    return std::string("<") + name + "><exact>" + std::to_string(value) + "</exact></" + name + ">";
  };
  return "<" + tag + "><position><point><x>" + std::to_string(x) + "</x><y>" + std::to_string(y) +
         "</y></point></position>" + exact("orientation", heading) + exact("time", step) +
         exact("velocity", speed) + "</" + tag + ">";
}

const std::string kCarShape =
    "<shape><rectangle><length>4.5</length><width>1.9</width></rectangle></shape>";

// Drives along y = 3 for 20 steps, 1 m each.
std::string DrivenCar(const std::string& tag, const std::string& before_type) {
  std::string states;
  for (int i = 1; i <= 20; ++i) states += State("state", i, i, 3.0, 0.0, 10.0);
  return "<" + tag + " id=\"7\">" + before_type + "<type>car</type>" + kCarShape +
         State("initialState", 0, 0.0, 3.0, 0.0, 10.0) + "<trajectory>" + states +
         "</trajectory></" + tag + ">";
}

// Returns the text without the elements of that name.
std::string Without(const std::string& name, std::string xml) {
  const std::string end = "</" + name + ">";
  for (size_t at = 0; (at = xml.find("<" + name + ">")) != xml.npos;) {
    xml.erase(at, xml.find(end, at) + end.size() - at);
  }
  return xml;
}

std::string File(const std::string& version, const std::string& content) {
  return "<?xml version=\"1.0\"?><commonRoad benchmarkID=\"TST_Road-1\" commonRoadVersion=\"" +
         version + "\" timeStepSize=\"0.1\">" + content + "</commonRoad>";
}

v1::Scenario Parse(const std::string& xml) {
  const auto scenario = ParseCommonRoad(xml);
  EXPECT_TRUE(scenario.ok()) << scenario.status();
  if (!scenario.ok()) return {};
  EXPECT_TRUE(scene::ValidateScenario(*scenario, scene::ScenarioLimits()).empty());
  return *scenario;
}

class BothVersionsTest : public testing::TestWithParam<bool> {};

TEST_P(BothVersionsTest, AnObstaclesStatesAreItsInitialStateAndItsTrajectory) {
  const v1::Scenario scenario =
      Parse(GetParam() ? File("2018b", DrivenCar("obstacle", "<role>dynamic</role>"))
                       : File("2020a", DrivenCar("dynamicObstacle", "")));
  EXPECT_EQ(scenario.scenario_id(), "TST_Road-1");
  EXPECT_DOUBLE_EQ(scenario.prediction_time(), 1.0);
  ASSERT_EQ(scenario.agents_size(), 1);
  const v1::Agent& car = scenario.agents(0);
  EXPECT_EQ(car.id(), 7);
  EXPECT_EQ(car.type(), v1::AGENT_TYPE_VEHICLE);
  EXPECT_DOUBLE_EQ(car.length(), 4.5);
  EXPECT_DOUBLE_EQ(car.width(), 1.9);
  ASSERT_EQ(car.states_size(), 21);
  EXPECT_DOUBLE_EQ(car.states(20).time(), 2.0);
  EXPECT_DOUBLE_EQ(car.states(20).x(), 20.0);
  EXPECT_DOUBLE_EQ(car.states(20).y(), 3.0);
}

INSTANTIATE_TEST_SUITE_P(Versions, BothVersionsTest, testing::Bool(),
                         [](const auto& version) { return version.param ? "of2018b" : "of2020a"; });

TEST(CommonRoadTest, VelocityPointsAlongTheWrappedHeading) {
  const v1::Scenario scenario = Parse(File(
      "2020a", "<dynamicObstacle id=\"1\"><type>bicycle</type>" + kCarShape +
                   State("initialState", 0, 0.0, 0.0, 2.5 * M_PI, 4.0) + "</dynamicObstacle>"));
  const v1::AgentState& state = scenario.agents(0).states(0);
  EXPECT_EQ(scenario.agents(0).type(), v1::AGENT_TYPE_CYCLIST);
  EXPECT_NEAR(state.heading(), M_PI / 2, 1e-6);
  EXPECT_NEAR(state.velocity_x(), 0.0, 1e-5);
  EXPECT_NEAR(state.velocity_y(), 4.0, 1e-5);
}

TEST(CommonRoadTest, AStateWithoutAVelocityHasThatOfTheWayFromTheStateBefore) {
  const v1::Scenario scenario =
      Parse(File("2020a", Without("velocity", DrivenCar("dynamicObstacle", ""))));
  ASSERT_EQ(scenario.agents(0).states_size(), 21);
  for (const v1::AgentState& state : scenario.agents(0).states()) {
    EXPECT_NEAR(state.velocity_x(), 10.0, 1e-5) << state.time();
    EXPECT_NEAR(state.velocity_y(), 0.0, 1e-5) << state.time();
  }
  // It stands, then moves 1 m back and 2 m to its left in half a second.
  const auto without_velocity = [](const std::string& tag, int step, double x, double y) {
    return Without("velocity", State(tag, step, x, y, 0.0, 0.0));
  };
  const std::string first = "<dynamicObstacle id=\"1\"><type>car</type>" + kCarShape +
                            without_velocity("initialState", 0, 4.0, 0.0);
  const v1::Scenario moves = Parse(File(
      "2020a", first + "<trajectory>" + State("state", 1, 4.0, 0.0, 0.0, 7.0) +
                   without_velocity("state", 6, 3.0, 2.0) + "</trajectory></dynamicObstacle>"));
  ASSERT_EQ(moves.agents(0).states_size(), 3);
  EXPECT_FLOAT_EQ(moves.agents(0).states(0).velocity_x(), 0.0F);
  EXPECT_FLOAT_EQ(moves.agents(0).states(1).velocity_x(), 7.0F);  // as stated
  EXPECT_NEAR(moves.agents(0).states(2).velocity_x(), -2.0, 1e-5);
  EXPECT_NEAR(moves.agents(0).states(2).velocity_y(), 4.0, 1e-5);

  const v1::Scenario alone = Parse(File("2020a", first + "</dynamicObstacle>"));
  EXPECT_EQ(alone.agents(0).states(0).velocity_x(), 0.0F);
}

TEST(CommonRoadTest, AStateThatIsOnlyInLaneletsIsLeftOut) {
  const std::string state =
      "<state><position><lanelet ref=\"5\"/></position><time><exact>21</exact></time></state>";
  std::string car = DrivenCar("dynamicObstacle", "");
  car.insert(car.find("</trajectory>"), state);
  EXPECT_EQ(Parse(File("2020a", car)).agents(0).states_size(), 21);
}

TEST(CommonRoadTest, AStaticObstacleHasAStateAtEveryStep) {
  const std::string parked = "<staticObstacle id=\"9\"><type>parkedVehicle</type>" + kCarShape +
                             State("initialState", 0, 5.0, -2.0, 0.5, 0.0) + "</staticObstacle>";
  const v1::Scenario scenario = Parse(File("2020a", parked + DrivenCar("dynamicObstacle", "")));
  ASSERT_EQ(scenario.agents_size(), 2);
  const v1::Agent& stands = scenario.agents(0);
  ASSERT_EQ(stands.states_size(), 21);
  EXPECT_DOUBLE_EQ(stands.states(20).time(), 2.0);
  EXPECT_DOUBLE_EQ(stands.states(20).x(), 5.0);
  // In the older version, the role says that it is static.
  const v1::Scenario older =
      Parse(File("2018b", DrivenCar("obstacle", "<role>dynamic</role>") +
                              "<obstacle id=\"9\"><role>static</role><type>car</type>" + kCarShape +
                              State("initialState", 0, 5.0, -2.0, 0.5, 0.0) + "</obstacle>"));
  EXPECT_EQ(older.agents(1).states_size(), 21);
}

TEST(CommonRoadTest, AStaticObstacleHasNoMoreStatesThanAScenarioMayHave) {
  const auto states_from = [](int step) {
    const std::string parked = "<staticObstacle id=\"9\"><type>parkedVehicle</type>" + kCarShape +
                               State("initialState", step, 5.0, -2.0, 0.5, 0.0) +
                               "</staticObstacle>";
    return Parse(File("2020a", parked + DrivenCar("dynamicObstacle", ""))).agents(0);
  };
  EXPECT_EQ(states_from(18).states_size(), 3);
  EXPECT_DOUBLE_EQ(states_from(18).states(2).time(), 2.0);
  EXPECT_EQ(states_from(1'000'000'000).states_size(), 1);
  const v1::Agent long_ago = states_from(-1'000'000'000);
  ASSERT_EQ(long_ago.states_size(), scene::ScenarioLimits().max_states_per_agent);
  EXPECT_DOUBLE_EQ(long_ago.states(1).time(), -99'999'999.9);
}

TEST(CommonRoadTest, TakesTheMiddleOfAnIntervalAndTheCentreOfAnArea) {
  const v1::Scenario scenario =
      Parse(File("2018b", "<obstacle id=\"1\"><role>dynamic</role><type>car</type>" + kCarShape +
                              "<initialState><position><circle><radius>2</radius>"
                              "<center><x>3</x><y>4</y></center></circle></position>"
                              "<orientation><exact>0</exact></orientation>"
                              "<time><exact>0</exact></time>"
                              "<velocity><intervalStart>4</intervalStart>"
                              "<intervalEnd>6</intervalEnd></velocity>"
                              "</initialState></obstacle>"));
  const v1::AgentState& state = scenario.agents(0).states(0);
  EXPECT_DOUBLE_EQ(state.x(), 3.0);
  EXPECT_DOUBLE_EQ(state.y(), 4.0);
  EXPECT_FLOAT_EQ(state.velocity_x(), 5.0F);
  const v1::Scenario polygon = Parse(
      File("2020a", "<dynamicObstacle id=\"1\"><type>car</type>" + kCarShape +
                        "<initialState><position><polygon><point><x>2</x><y>1</y></point>"
                        "<point><x>6</x><y>1</y></point><point><x>6</x><y>4</y></point></polygon>"
                        "</position><orientation><exact>0</exact></orientation>"
                        "<time><exact>0</exact></time></initialState></dynamicObstacle>"));
  EXPECT_DOUBLE_EQ(polygon.agents(0).states(0).x(), 4.0);
  EXPECT_DOUBLE_EQ(polygon.agents(0).states(0).y(), 2.5);
}

TEST(CommonRoadTest, AnyShapeBecomesTheBoxAroundIt) {
  const auto box = [](const std::string& shape) {
    const v1::Scenario scenario = Parse(File(
        "2020a", "<dynamicObstacle id=\"1\"><type>pedestrian</type><shape>" + shape + "</shape>" +
                     State("initialState", 0, 0.0, 0.0, 0.0, 0.0) + "</dynamicObstacle>"));
    return std::pair(scenario.agents(0).length(), scenario.agents(0).width());
  };
  EXPECT_EQ(box("<circle><radius>0.4</radius></circle>"), std::pair(0.8, 0.8));
  EXPECT_EQ(box("<polygon><point><x>-1</x><y>-0.5</y></point><point><x>2</x><y>0</y></point>"
                "<point><x>0</x><y>1</y></point></polygon>"),
            std::pair(3.0, 1.5));
  const auto [length, width] =
      box("<rectangle><length>4</length><width>2</width><orientation>1.5707963267948966"
          "</orientation></rectangle>");
  EXPECT_NEAR(length, 2.0, 1e-9);
  EXPECT_NEAR(width, 4.0, 1e-9);
}

TEST(CommonRoadTest, AnObstacleIsWhereTheCentreOfItsBoxIs) {
  const auto agent = [](const std::string& shape, double heading) {
    return Parse(File("2020a", "<dynamicObstacle id=\"1\"><type>car</type><shape>" + shape +
                                   "</shape>" + State("initialState", 0, 10.0, 20.0, heading, 0.0) +
                                   "</dynamicObstacle>"))
        .agents(0);
  };
  const std::string behind =
      "<rectangle><length>4</length><width>2</width><center><x>5</x><y>0</y></center></rectangle>";
  const v1::Agent ahead = agent(behind, 0.0);
  EXPECT_DOUBLE_EQ(ahead.length(), 4.0);
  EXPECT_DOUBLE_EQ(ahead.states(0).x(), 15.0);
  EXPECT_DOUBLE_EQ(ahead.states(0).y(), 20.0);
  const v1::Agent north = agent(behind, 1.5707963);
  EXPECT_NEAR(north.states(0).x(), 10.0, 1e-5);
  EXPECT_NEAR(north.states(0).y(), 25.0, 1e-5);
  const v1::Agent polygon = agent(
      "<polygon><point><x>-1</x><y>-0.5</y></point><point><x>2</x><y>0</y></point>"
      "<point><x>0</x><y>1</y></point></polygon>",
      0.0);
  EXPECT_DOUBLE_EQ(polygon.states(0).x(), 10.5);
  EXPECT_DOUBLE_EQ(polygon.states(0).y(), 20.25);
}

const std::string kBounds =
    "<leftBound><point><x>0</x><y>2</y></point><point><x>50</x><y>2</y></point></leftBound>"
    "<rightBound><point><x>0</x><y>-2</y></point><point><x>50</x><y>-2</y></point></rightBound>";

const v1::MapFeature* Find(const v1::Scenario& scenario, v1::MapFeatureType type) {
  for (const v1::MapFeature& feature : scenario.map_features()) {
    if (feature.type() == type) return &feature;
  }
  return nullptr;
}

TEST(CommonRoadTest, ReadsSpeedLimitsFromLaneletsAndSignsAndPutsStopLinesAtTheEnd) {
  const v1::Scenario older =
      Parse(File("2018b", DrivenCar("obstacle", "<role>dynamic</role>") + "<lanelet id=\"5\">" +
                              kBounds + "<speedLimit>13.5</speedLimit></lanelet>"));
  const v1::MapFeature* lane = Find(older, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
  ASSERT_NE(lane, nullptr);
  EXPECT_EQ(lane->id(), 5);
  EXPECT_DOUBLE_EQ(lane->speed_limit(), 13.5);
  EXPECT_THAT(lane->y(), testing::ElementsAre(0.0, 0.0));

  const v1::Scenario newer =
      Parse(File("2020a", DrivenCar("dynamicObstacle", "") + "<lanelet id=\"5\">" + kBounds +
                              "<stopLine><lineMarking>solid</lineMarking></stopLine>"
                              "<trafficSignRef ref=\"70\"/><trafficSignRef ref=\"71\"/></lanelet>"
                              "<trafficSign id=\"70\"><trafficSignElement><trafficSignID>R3-4"
                              "</trafficSignID></trafficSignElement></trafficSign>"
                              "<trafficSign id=\"71\"><trafficSignElement><trafficSignID>R2-1"
                              "</trafficSignID><additionalValue>11.2</additionalValue>"
                              "</trafficSignElement></trafficSign>"));
  EXPECT_DOUBLE_EQ(Find(newer, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE)->speed_limit(), 11.2);
  const v1::MapFeature* stop = Find(newer, v1::MAP_FEATURE_TYPE_STOP_LINE);
  ASSERT_NE(stop, nullptr);
  EXPECT_THAT(stop->x(), testing::ElementsAre(50.0, 50.0));
}

TEST(CommonRoadTest, ALaneHasItsSuccessorsAndNeighborsInTheSameDirection) {
  const v1::Scenario scenario =
      Parse(File("2020a", DrivenCar("dynamicObstacle", "") + "<lanelet id=\"5\">" + kBounds +
                              "<predecessor ref=\"4\"/><successor ref=\"6\"/><successor ref=\"8\"/>"
                              "<adjacentLeft ref=\"9\" drivingDir=\"opposite\"/>"
                              "<adjacentRight ref=\"10\" drivingDir=\"same\"/></lanelet>"
                              "<lanelet id=\"4\">" +
                              kBounds + "</lanelet>"));
  ASSERT_EQ(scenario.map_features(0).id(), 5);
  EXPECT_THAT(scenario.map_features(0).successor_ids(), testing::ElementsAre(6, 8));
  EXPECT_THAT(scenario.map_features(0).left_neighbor_ids(), testing::IsEmpty());
  EXPECT_THAT(scenario.map_features(0).right_neighbor_ids(), testing::ElementsAre(10));
  for (const v1::MapFeature& feature : scenario.map_features()) {
    if (feature.id() == 4) {
      EXPECT_THAT(feature.successor_ids(), testing::ElementsAre(5));
    }
  }
}

// Three lanelets after the one of kBounds: straight on, to the left, to the right.
const std::string kJunction =
    "<lanelet id=\"6\"><leftBound><point><x>50</x><y>2</y></point><point><x>80</x><y>2</y></point>"
    "</leftBound><rightBound><point><x>50</x><y>-2</y></point><point><x>80</x><y>-2</y></point>"
    "</rightBound></lanelet>"
    "<lanelet id=\"7\"><leftBound><point><x>50</x><y>2</y></point><point><x>58</x><y>2</y></point>"
    "<point><x>58</x><y>20</y></point></leftBound><rightBound><point><x>50</x><y>-2</y></point>"
    "<point><x>62</x><y>-2</y></point><point><x>62</x><y>20</y></point></rightBound></lanelet>"
    "<lanelet id=\"8\"><leftBound><point><x>50</x><y>2</y></point><point><x>62</x><y>2</y></point>"
    "<point><x>62</x><y>-20</y></point></leftBound><rightBound><point><x>50</x><y>-2</y></point>"
    "<point><x>58</x><y>-2</y></point><point><x>58</x><y>-20</y></point></rightBound></lanelet>";

// Green for 5 steps, yellow for 3, red for 10. The cycle starts at step 2, so step 0 is in the red
// before it.
TEST(CommonRoadTest, ALightControlsTheLanesAfterTheLaneletsThatReferToIt) {
  const auto light = [](const std::string& id, const std::string& direction,
                        const std::string& more) {
    return "<trafficLight id=\"" + id +
           "\"><cycle><cycleElement><duration>5</duration><color>green</color></cycleElement>"
           "<cycleElement><duration>3</duration><color>yellow</color></cycleElement>"
           "<cycleElement><duration>10</duration><color>red</color></cycleElement>"
           "<timeOffset>2</timeOffset></cycle><direction>" +
           direction + "</direction>" + more + "</trafficLight>";
  };
  const v1::Scenario scenario = Parse(
      File("2020a", DrivenCar("dynamicObstacle", "") + "<lanelet id=\"5\">" + kBounds +
                        "<successor ref=\"6\"/><successor ref=\"7\"/><successor ref=\"8\"/>"
                        "<trafficLightRef ref=\"80\"/><trafficLightRef ref=\"81\"/></lanelet>" +
                        kJunction + light("80", "left", "<active>false</active>") +
                        light("81", "straightRight", "")));
  ASSERT_EQ(scenario.traffic_signals_size(), 3);
  const v1::TrafficSignal& signal = scenario.traffic_signals(0);
  EXPECT_EQ(signal.lane_id(), 6);
  EXPECT_EQ(scenario.traffic_signals(1).lane_id(), 7);
  ASSERT_EQ(scenario.traffic_signals(1).readings_size(), 1);
  EXPECT_EQ(scenario.traffic_signals(1).readings(0).state(), v1::TRAFFIC_SIGNAL_STATE_UNSPECIFIED);
  EXPECT_EQ(scenario.traffic_signals(2).lane_id(), 8);
  EXPECT_EQ(scenario.traffic_signals(2).readings_size(), signal.readings_size());
  std::vector<std::pair<double, v1::TrafficSignalState>> shown;
  for (const v1::TrafficSignalReading& reading : signal.readings()) {
    shown.emplace_back(std::round(reading.time() * 10.0), reading.state());
  }
  EXPECT_THAT(shown, testing::ElementsAre(std::pair(0.0, v1::TRAFFIC_SIGNAL_STATE_STOP),
                                          std::pair(2.0, v1::TRAFFIC_SIGNAL_STATE_GO),
                                          std::pair(7.0, v1::TRAFFIC_SIGNAL_STATE_CAUTION),
                                          std::pair(10.0, v1::TRAFFIC_SIGNAL_STATE_STOP),
                                          std::pair(20.0, v1::TRAFFIC_SIGNAL_STATE_GO)));
}

TEST(CommonRoadTest, ARepeatedPointDoesNotTurnALane) {
  const auto light = [](const std::string& id, const std::string& direction,
                        const std::string& color) {
    return "<trafficLight id=\"" + id + "\"><cycle><cycleElement><duration>5</duration><color>" +
           color + "</color></cycleElement></cycle><direction>" + direction +
           "</direction></trafficLight>";
  };
  // Returns what a lane to the west along these x shows, behind a red light for a turn and a green
  // one for going straight.
  const auto shown = [&light](const std::vector<std::string>& xs, const std::string& turn) {
    const auto bound = [&xs](const std::string& name, const std::string& y) {
      std::string points;
      for (const std::string& x : xs) points += "<point><x>" + x + "</x><y>" + y + "</y></point>";
      return "<" + name + ">" + points + "</" + name + ">";
    };
    const v1::Scenario scenario =
        Parse(File("2020a", DrivenCar("dynamicObstacle", "") + "<lanelet id=\"5\">" + kBounds +
                                "<successor ref=\"6\"/><trafficLightRef ref=\"80\"/>"
                                "<trafficLightRef ref=\"81\"/></lanelet><lanelet id=\"6\">" +
                                bound("leftBound", "-2") + bound("rightBound", "2") + "</lanelet>" +
                                light("80", turn, "red") + light("81", "straight", "green")));
    EXPECT_EQ(scenario.traffic_signals_size(), 1);
    return scenario.traffic_signals(0).readings(0).state();
  };
  EXPECT_EQ(shown({"0", "0", "-30"}, "left"), v1::TRAFFIC_SIGNAL_STATE_GO);
  EXPECT_EQ(shown({"0", "-30", "-30"}, "right"), v1::TRAFFIC_SIGNAL_STATE_GO);
}

TEST(CommonRoadTest, SmallFilesDoNotBecomeLarge) {
  std::string parked;
  for (int i = 0; i <= scene::ScenarioLimits().max_agents; ++i) {
    parked += "<staticObstacle id=\"" + std::to_string(i) + "\"><type>car</type>" + kCarShape +
              State("initialState", 0, 5.0, -2.0, 0.5, 0.0) + "</staticObstacle>";
  }
  const auto many = ParseCommonRoad(File("2020a", parked));
  EXPECT_THAT(std::string(many.status().message()), HasSubstr("more than 2000 obstacles"));

  std::string cycle;
  for (int i = 0; i < 3'000; ++i) {
    cycle += "<cycleElement><duration>1</duration><color>";
    cycle += i % 2 == 0 ? "red" : "green";
    cycle += "</color></cycleElement>";
  }
  const auto flickers = ParseCommonRoad(File(
      "2020a", "<dynamicObstacle id=\"1\"><type>car</type>" + kCarShape +
                   State("initialState", 10'000, 0.0, 0.0, 0.0, 0.0) +
                   "</dynamicObstacle><lanelet id=\"5\">" + kBounds +
                   "<successor ref=\"6\"/><trafficLightRef ref=\"80\"/></lanelet>" + kJunction +
                   "<trafficLight id=\"80\"><cycle>" + cycle + "</cycle></trafficLight>"));
  EXPECT_THAT(std::string(flickers.status().message()),
              HasSubstr("trafficLight 80 changes more than 2000 times"));
}

TEST(CommonRoadTest, RefusesBoundsWithMorePointsThanAMapMayHave) {
  std::string points;
  for (int i = 0; i < scene::ScenarioLimits().max_map_points; ++i) {
    points += "<point><x>0</x><y>2</y></point>";
  }
  std::string lanelet = "<lanelet id=\"5\">" + kBounds + "</lanelet>";
  lanelet.insert(lanelet.find("<point>"), points);
  const auto scenario = ParseCommonRoad(File("2020a", DrivenCar("dynamicObstacle", "") + lanelet));
  EXPECT_THAT(std::string(scenario.status().message()),
              HasSubstr("more than 500000 points in bounds"));
}

TEST(CommonRoadTest, ErrorsNameTheElement) {
  const auto problem = [](const std::string& xml) {
    const auto scenario = ParseCommonRoad(xml);
    EXPECT_EQ(scenario.status().code(), absl::StatusCode::kInvalidArgument) << xml;
    return std::string(scenario.status().message());
  };
  const std::string car = DrivenCar("dynamicObstacle", "");
  EXPECT_THAT(problem("not XML"), HasSubstr("no XML"));
  EXPECT_THAT(problem(File("2020a", car).substr(0, 400)), HasSubstr("no XML"));
  EXPECT_THAT(problem("<osm/>"), HasSubstr("<commonRoad>"));
  EXPECT_THAT(problem(File("2017a", car)), HasSubstr("2017a"));
  EXPECT_THAT(problem(File("2020a", "")), HasSubstr("no obstacles"));
  EXPECT_THAT(problem(File("2020a", car + "<lanelet id=\"5\"/>")), HasSubstr("lanelet 5"));
  std::string wrong = car;
  wrong.replace(wrong.find("<length>4.5"), 11, "<length>wide");
  EXPECT_THAT(problem(File("2020a", wrong)),
              HasSubstr("obstacle 7: shape: length is not a number"));
  wrong = car;
  wrong.replace(wrong.find("<exact>2.0"), 10, "<exact>1.0");
  EXPECT_THAT(problem(File("2020a", wrong)), HasSubstr("later than the one before"));
  const size_t second = car.find("<state>");
  for (const char* name : {"time", "orientation"}) {
    EXPECT_THAT(problem(File("2020a", car.substr(0, second) + Without(name, car.substr(second)))),
                HasSubstr(std::string("obstacle 7: state of its trajectory has no ") + name));
  }
  std::string no_step = File("2020a", car);
  no_step.replace(no_step.find("timeStepSize=\"0.1\""), 18, "");
  EXPECT_THAT(problem(no_step), HasSubstr("timeStepSize"));
  std::string endless_step = File("2020a", car);
  endless_step.replace(endless_step.find("timeStepSize=\"0.1\""), 18, "timeStepSize=\"inf\"");
  EXPECT_THAT(problem(endless_step), HasSubstr("timeStepSize"));
  wrong = car;
  wrong.replace(wrong.rfind("<exact>20.0"), 11, "<exact>1e308");
  std::string long_step = File("2020a", wrong);
  long_step.replace(long_step.find("timeStepSize=\"0.1\""), 18, "timeStepSize=\"1e2\"");
  EXPECT_THAT(problem(long_step), HasSubstr("obstacle 7: state of its trajectory: time"));
  for (const char* duration : {"0", "-5", "1e10", "4611686018427387904", "nan"}) {
    std::string light = "<trafficLight id=\"80\"><cycle>";
    for (int i = 0; i < 4; ++i) {
      light += std::string("<cycleElement><duration>") + duration +
               "</duration><color>green</color></cycleElement>";
    }
    light += "</cycle></trafficLight>";
    EXPECT_THAT(problem(File("2020a", car + "<lanelet id=\"5\">" + kBounds +
                                          "<successor ref=\"6\"/>"
                                          "<trafficLightRef ref=\"80\"/></lanelet>" +
                                          kJunction + light)),
                HasSubstr("trafficLight 80: duration"));
  }
}

}  // namespace
}  // namespace maneuver::data::commonroad_reader_test

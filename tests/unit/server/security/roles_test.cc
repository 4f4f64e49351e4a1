#include "server/security/roles.h"

#include <google/protobuf/descriptor.h>
#include <gtest/gtest.h>

#include <set>
#include <string>

#include "tests/integration/all_methods.h"

namespace maneuver::security::roles_test {
namespace {

std::set<std::string> MethodsOfTheContract() {
  std::set<std::string> methods;
  for (const auto* method : integration::AllMethods()) {
    methods.insert("/" + method->service()->full_name() + "/" + method->name());
  }
  return methods;
}

TEST(RolesTest, EveryMethodOfTheContractHasARowAndEveryRowAMethod) {
  std::set<std::string> declared;
  for (const MethodRole& row : MethodRoles()) {
    EXPECT_TRUE(declared.insert(std::string(row.method)).second) << "twice: " << row.method;
  }
  for (const std::string& method : MethodsOfTheContract()) {
    EXPECT_EQ(declared.erase(method), 1u) << "nobody may call " << method;
    EXPECT_NE(RequiredRole(method), Role::kAnyone) << method;
  }
  // The rest are gRPC's own methods, deliberately open.
  EXPECT_EQ(declared, (std::set<std::string>{
                          "/grpc.health.v1.Health/Check", "/grpc.health.v1.Health/Watch",
                          "/grpc.reflection.v1.ServerReflection/ServerReflectionInfo",
                          "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo"}));
}

TEST(RolesTest, AMethodWithoutARowHasNoRole) {
  EXPECT_EQ(RequiredRole("/maneuver.v1.PredictionService/Predict"), Role::kPredict);
  for (const char* method :
       {"", "/", "/maneuver.v1.PredictionService/Predict2", "maneuver.v1.PredictionService/Predict",
        "/maneuver.v1.PredictionService/"}) {
    EXPECT_EQ(RequiredRole(method), std::nullopt) << method;
  }
}

TEST(RolesTest, RolesDoNotIncludeOneAnother) {
  const auto admin = RoleSet::Parse("admin");
  ASSERT_TRUE(admin.ok());
  EXPECT_TRUE(admin->Contains(Role::kAdmin));
  EXPECT_FALSE(admin->Contains(Role::kPredict));
  EXPECT_FALSE(admin->Contains(Role::kTrain));
  EXPECT_EQ(RoleSet::Parse("admin,predict")->ToString(), "predict,admin");
  for (const char* text : {"", "anyone", "Predict", "predict,", ",predict", "predict;train"}) {
    EXPECT_FALSE(RoleSet::Parse(text).ok()) << text;
  }
}

}  // namespace
}  // namespace maneuver::security::roles_test

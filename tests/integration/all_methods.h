#ifndef MANEUVER_TESTS_INTEGRATION_ALL_METHODS_H_
#define MANEUVER_TESTS_INTEGRATION_ALL_METHODS_H_

#include <google/protobuf/descriptor.h>

#include <vector>

namespace maneuver::integration {

// Returns the methods of all services of the contract.
std::vector<const google::protobuf::MethodDescriptor*> AllMethods();

}  // namespace maneuver::integration

#endif  // MANEUVER_TESTS_INTEGRATION_ALL_METHODS_H_

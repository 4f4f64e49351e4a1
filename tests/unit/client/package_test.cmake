# Installs the package maneuver-client under a temporary prefix and builds and
# runs a program of another project against it.
#   cmake -DBUILD=<build folder> -DWORK=<scratch folder> -DCOMPILER=<C++ compiler> -P package_test.cmake
set(prefix "${WORK}/prefix")
file(REMOVE_RECURSE "${WORK}")
file(MAKE_DIRECTORY "${WORK}/source")

function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE status OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(NOT status EQUAL 0)
    list(JOIN ARGN " " command)
    message(FATAL_ERROR "${command}: ${status}\n${output}")
  endif()
endfunction()

run("${CMAKE_COMMAND}" --install "${BUILD}" --component client --prefix "${prefix}")
file(WRITE "${WORK}/source/CMakeLists.txt" [[
cmake_minimum_required(VERSION 3.25)
project(planner LANGUAGES CXX)
find_package(maneuver-client 0.1 REQUIRED)
add_executable(planner main.cc)
target_link_libraries(planner PRIVATE maneuver::client)
]])
# Nobody listens at port 1: the call goes all the way, and says so.
file(WRITE "${WORK}/source/main.cc" [[
#include "client/client.h"

int main() {
  auto client = maneuver::client::Client::Connect({.address = "127.0.0.1:1", .retry = {.max_attempts = 1}});
  maneuver::v1::PredictRequest request;
  request.set_model("models/town");
  auto answer = (*client)->Predict(request);
  return absl::IsUnavailable(answer.status()) ? 0 : 1;
}
]])
run("${CMAKE_COMMAND}" -S "${WORK}/source" -B "${WORK}/build" -G Ninja
  "-DCMAKE_PREFIX_PATH=${prefix}" "-DCMAKE_CXX_COMPILER=${COMPILER}" -DCMAKE_CXX_FLAGS=${FLAGS})
run("${CMAKE_COMMAND}" --build "${WORK}/build")
run("${WORK}/build/planner")
foreach(file share/maneuver/proto/maneuver/v1/prediction_service.proto)
  if(NOT EXISTS "${prefix}/${file}")
    message(FATAL_ERROR "${file} was not installed")
  endif()
endforeach()
file(REMOVE_RECURSE "${WORK}")

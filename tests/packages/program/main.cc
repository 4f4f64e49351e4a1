// What a planner's program begins with: it lists the models of a server.
#include <iostream>

#include "client/client.h"

int main(int, char** argv) {
  const auto client = maneuver::client::Client::Connect({.address = argv[1]});
  if (!client.ok()) return std::cerr << client.status() << "\n", 1;
  maneuver::v1::ListModelVersionsRequest request;
  request.set_parent("models/-");
  const auto models = (*client)->ListModelVersions(request);
  if (!models.ok()) return std::cerr << models.status() << "\n", 1;
  for (const auto& version : models->model_versions()) std::cout << version.name() << "\n";
}

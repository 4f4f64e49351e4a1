#include "client/cli/resource_names.h"

namespace maneuver::cli {
namespace {

constexpr std::string_view kModels = "models/";
constexpr std::string_view kVersions = "/versions/";

std::string WithPrefix(std::string_view prefix, std::string_view name) {
  if (name.empty() || name.substr(0, prefix.size()) == prefix) return std::string(name);
  return std::string(prefix) + std::string(name);
}

}  // namespace

std::string ModelResource(std::string_view name) {
  std::string full = WithPrefix(kModels, name);
  const size_t slash = full.find('/', kModels.size());
  if (full.size() <= kModels.size() || slash == std::string::npos) return full;
  if (full.find('/', slash + 1) != std::string::npos) return full;
  return full.replace(slash, 1, kVersions);
}

std::string DatasetResource(std::string_view name) { return WithPrefix("datasets/", name); }

std::string TagsResource(std::string_view name) { return WithPrefix("tags/", name); }

std::string JobResource(std::string_view name) { return WithPrefix("jobs/", name); }

std::string ShortName(std::string_view resource) {
  for (const std::string_view prefix : {kModels, std::string_view("datasets/"),
                                        std::string_view("tags/"), std::string_view("jobs/")}) {
    if (resource.substr(0, prefix.size()) == prefix) {
      resource.remove_prefix(prefix.size());
      break;
    }
  }
  std::string name(resource);
  const size_t versions = name.find(kVersions);
  if (versions != std::string::npos) name.replace(versions, kVersions.size(), "/");
  return name;
}

}  // namespace maneuver::cli

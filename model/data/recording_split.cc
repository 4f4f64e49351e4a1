#include "model/data/recording_split.h"

#include "absl/strings/str_cat.h"
#include "model/data/stable_hash.h"
#include "model/files/digest.h"

namespace maneuver::data {
namespace {

constexpr char kPartMark = '#';

}  // namespace

std::string PartId(std::string_view id, int part) { return PartId(id, std::to_string(part)); }

std::string PartId(std::string_view id, std::string_view part) {
  return absl::StrCat(std::string(id), std::string(1, kPartMark), std::string(part));
}

std::string IdFromContent(std::string_view content) {
  return absl::StrCat("nosid-", files::Sha256Hex(content).substr(0, 8));
}

std::string_view WithoutPart(std::string_view scenario_id) {
  return scenario_id.substr(0, scenario_id.find(kPartMark));
}

bool HeldOut(std::string_view scenario_id, double validation_share) {
  // Mixed once more: FNV-1a alone leaves short similar ids close together.
  return UnitInterval(MixHash(StableHash(WithoutPart(scenario_id)), 0)) < validation_share;
}

}  // namespace maneuver::data

// The ids of recordings, and which side of the validation split a recording is on.
//
// A long recording may be stored in parts, and different recordings may come with one id. Their ids
// are then "{id}#1", "{id}#2" and so on. Parts stay together, because a model that learned from one
// part has seen the place of the others. Importers name recordings of one drive by parts, such as
// "{log}#{scene}".

#ifndef MANEUVER_MODEL_DATA_RECORDING_SPLIT_H_
#define MANEUVER_MODEL_DATA_RECORDING_SPLIT_H_

#include <string>
#include <string_view>

namespace maneuver::data {

// Returns the id of part `part` of the recording `id`, as in "crossing#2".
std::string PartId(std::string_view id, int part);
std::string PartId(std::string_view id, std::string_view part);

// Returns an id for a recording that has none: "nosid-" and eight hexadecimal digits.
//   content: what was recorded
std::string IdFromContent(std::string_view content);

// Returns the id without its part: up to the first '#'.
std::string_view WithoutPart(std::string_view scenario_id);

// Returns whether a recording is held out for validation. Decides by a hash of its id without the
// part, so that a recording is on the same side in every run and in every dataset, and so that a
// larger share holds out whatever a smaller one does.
//   validation_share: in [0, 1)
bool HeldOut(std::string_view scenario_id, double validation_share);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_RECORDING_SPLIT_H_

// Finds the nonzero values of a raster.

#ifndef MANEUVER_MODEL_SCENE_NONZERO_SEARCH_H_
#define MANEUVER_MODEL_SCENE_NONZERO_SEARCH_H_

#include <cstdint>
#include <vector>

#include "model/kernels/nonzero_values.h"
#include "model/scene/raster.h"

namespace maneuver::scene {

// Holds scratch memory: use one per thread.
class NonzeroSearch {
 public:
  // Finds the nonzero values of the channels from `first_channel` on. Returns false, with the
  // values of the first rows, if there are more than `most`.
  //   values: is replaced; its memory is used again
  bool Find(const Raster& raster, int first_channel, int64_t most, kernels::NonzeroValues* values);

 private:
  // A channel that may be nonzero in a row.
  struct RowChannel {
    int channel;
    PixelBlocks blocks;
  };
  // A channel that is nonzero in a block of eight pixels.
  struct ByteGroup {
    int channel;
    uint64_t pixels;  // a byte for each
  };

  // Finds the values of up to eight pixels of a row from `column` on.
  void FindGroup(const Raster& raster, int row, int column, kernels::NonzeroValues* values);

  std::vector<RowChannel> in_row_;
  std::vector<ByteGroup> in_group_;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_NONZERO_SEARCH_H_

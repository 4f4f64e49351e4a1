// A set of cells of a grid, for example those that depend on nonzero pixels of a raster.
//
// Most of a raster is zero. A cell whose whole receptive field is zero always has the same output,
// so only the other cells need to be computed.

#ifndef MANEUVER_MODEL_INFERENCE_CELL_MASK_H_
#define MANEUVER_MODEL_INFERENCE_CELL_MASK_H_

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "model/artifact/backbone_layers.h"
#include "model/scene/raster.h"

namespace maneuver::inference {

class CellMask {
 public:
  // Makes an empty mask for a grid of this size.
  CellMask(int height, int width);

  int height() const { return height_; }
  int width() const { return width_; }

  bool Has(int row, int column) const {
    return (Row(row)[column / kBits] >> (column % kBits) & 1) != 0;
  }
  // Returns whether any of `count` neighbouring cells of a row is set. They must lie in one 64-bit
  // word of the row.
  bool HasAny(int row, int column, int count) const {
    return (Row(row)[column / kBits] >> (column % kBits) & ((uint64_t{1} << count) - 1)) != 0;
  }
  bool HasAny(int row) const;
  // Returns whether any of columns begin .. end-1 of a row is set. Columns outside the grid count
  // as not set.
  bool HasAnyOf(int row, int begin, int end) const {
    begin = std::max(begin, 0);
    end = std::min(end, width_);
    if (begin >= end) return false;
    const uint64_t* const words = Row(row);
    const int first = begin / kBits;
    const int last = (end - 1) / kBits;
    const uint64_t from = ~uint64_t{0} << (begin % kBits);
    const uint64_t until = ~uint64_t{0} >> (kBits - 1 - (end - 1) % kBits);
    if (first == last) return (words[first] & from & until) != 0;
    uint64_t any = (words[first] & from) | (words[last] & until);
    for (int word = first + 1; word < last; ++word) any |= words[word];
    return any != 0;
  }

  void SetAll();
  // Sets exactly the pixels of a raster of this size that are nonzero in any of its first
  // `channels` channels.
  void SetPixels(const scene::Raster& raster, int channels);
  void Add(int row, int column) { Row(row)[column / kBits] |= uint64_t{1} << (column % kBits); }
  // Sets exactly the cells of a convolution's output whose kernel covers a cell of `input`.
  //   layer: the convolution; its output has this mask's size
  void SetDependent(const CellMask& input, const artifact::BackboneLayer& layer);

  // Calls `call` with the column of each cell that is set in a row, from left to right.
  template <typename Call>
  void ForEach(int row, const Call& call) const {
    for (int word = 0; word < words_; ++word) Columns(word, Row(row)[word], call);
  }
  // Calls `call` for each cell that is set here and not in `other`. Both grids have the same size.
  template <typename Call>
  void ForEachWithout(const CellMask& other, int row, const Call& call) const {
    for (int word = 0; word < words_; ++word) {
      Columns(word, Row(row)[word] & ~other.Row(row)[word], call);
    }
  }

 private:
  static constexpr int kBits = 64;

  template <typename Call>
  static void Columns(int word, uint64_t bits, const Call& call) {
    for (; bits != 0; bits &= bits - 1) call(word * kBits + std::countr_zero(bits));
  }

  const uint64_t* Row(int row) const { return &bits_[static_cast<size_t>(row * words_)]; }
  uint64_t* Row(int row) { return &bits_[static_cast<size_t>(row * words_)]; }
  // Clears the bits beyond a row's last cell.
  void ClearBeyondWidth(int row);

  int height_;
  int width_;
  int words_;                   // of a row
  std::vector<uint64_t> bits_;  // [height, words], the leftmost cell the lowest bit
  // Scratch of SetDependent for one row: the input cells under its kernels, and the kernels that cover a
  // set cell. They extend beyond the last cell by the size of a kernel.
  std::vector<uint64_t> met_;
  std::vector<uint64_t> seen_;
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_CELL_MASK_H_

// Some cells of a grid: those that see anything of a raster.
//
// Most of a raster is black. A cell whose whole receptive field is black puts out the same whatever
// else the raster shows, so that only the others need be computed.

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
  // Of a grid of that size: none of its cells.
  CellMask(int height, int width);

  int height() const { return height_; }
  int width() const { return width_; }

  bool Has(int row, int column) const {
    return (Row(row)[column / kBits] >> (column % kBits) & 1) != 0;
  }
  // Whether it has any of `count` neighbours of a row; they share one of its words.
  bool HasAny(int row, int column, int count) const {
    return (Row(row)[column / kBits] >> (column % kBits) & ((uint64_t{1} << count) - 1)) != 0;
  }
  bool HasAny(int row) const;
  // Whether it has any of columns begin .. end-1 of a row, of which some may lie outside.
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
  // The pixels of a raster of this size that are not black in all of its first channels.
  void SetPixels(const scene::Raster& raster, int channels);
  void Add(int row, int column) { Row(row)[column / kBits] |= uint64_t{1} << (column % kBits); }
  // The cells of a convolution's output whose kernels meet any cell of `input`.
  //   layer: its output is of this size
  void SetSeen(const CellMask& input, const artifact::BackboneLayer& layer);

  // Calls with each cell's column in a row, from the left to the right.
  template <typename Call>
  void ForEach(int row, const Call& call) const {
    for (int word = 0; word < words_; ++word) Columns(word, Row(row)[word], call);
  }
  // Likewise of those that `other`, of a grid of this size, has not.
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
  // Takes out what lies behind a row's last cell.
  void CutRow(int row);

  int height_;
  int width_;
  int words_;                   // of a row
  std::vector<uint64_t> bits_;  // [height, words], the leftmost cell the lowest bit
  // Of one row, while it is set: the cells above its kernels, and the kernels that meet any. They
  // go on as far behind the last cell as a kernel does.
  std::vector<uint64_t> met_;
  std::vector<uint64_t> seen_;
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_CELL_MASK_H_

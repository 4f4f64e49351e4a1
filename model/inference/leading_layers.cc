#include "model/inference/leading_layers.h"

#include <algorithm>
#include <cstring>
#include <utility>

namespace maneuver::inference {

using artifact::BackboneLayer;
using kernels::CellConvolution;

namespace {

bool CanComputeCells(const BackboneLayer& layer, bool bf16) {
  return layer.kind == BackboneLayer::Kind::kConvolution && !layer.adds &&
         CellConvolution::Supports(layer.input.channels, layer.output.channels, bf16);
}

}  // namespace

size_t LeadingLayers::Count(std::span<const BackboneLayer> layers, bool bf16) {
  if (layers.empty() || !FirstLayer::Supports(layers[0])) return 0;
  // What a residual block adds is read twice: those layers' outputs have to be whole.
  const bool plain =
      std::ranges::none_of(layers, [](const BackboneLayer& layer) { return layer.adds; });
  size_t count = 1;
  while (plain && count < layers.size() && CanComputeCells(layers[count], bf16) &&
         layers[count].source == layers[count - 1].destination) {
    ++count;
  }
  return count;
}

LeadingLayers::LeadingLayers(std::span<const BackboneLayer> layers,
                             std::span<const FoldedConvolution> folded, bool bf16, bool narrow)
    : layers_(layers.begin(), layers.end()),
      first_(layers[0], folded[0], layers.size() == 1 ? narrow : bf16),
      grids_(layers.size()) {
  for (size_t i = 0; i < layers_.size(); ++i) {
    const bool last = i + 1 == layers_.size();
    const bool narrow_output = last ? narrow : bf16;
    if (i > 0) {
      others_.emplace_back(kernels::CellShape{.kernel = layers_[i].kernel,
                                              .inputs = layers_[i].input.channels,
                                              .outputs = layers_[i].output.channels,
                                              .relu = layers_[i].relu},
                           folded[i].weight, folded[i].bias, bf16, narrow_output);
    }
    const artifact::GridSize& output = layers_[i].output;
    Grid& grid = grids_[i];
    grid.channels = output.channels;
    grid.padding = last ? 0 : layers_[i + 1].kernel / 2;
    grid.row_values = ptrdiff_t{output.width + 2 * grid.padding} * output.channels;
    grid.value_bytes = narrow_output ? sizeof(uint16_t) : sizeof(float);
    grid.zero_output.assign(
        static_cast<size_t>((output.height + 2 * grid.padding) * grid.row_values) *
            grid.value_bytes,
        std::byte{0});
  }
  Scratch scratch(*this);
  for (CellMask& mask : scratch.masks_) mask.SetAll();
  for (size_t i = 0; i < grids_.size(); ++i) scratch.places_[i] = grids_[i].zero_output.data();
  const artifact::GridSize& input = layers_[0].input;
  const scene::Raster zeros(input.height, input.width, input.channels);
  first_.FindNonzeroPixels(zeros, &scratch.first_);
  EvaluateCells(zeros, &scratch);
}

size_t LeadingLayers::bytes() const {
  size_t bytes = first_.bytes();
  for (const CellConvolution& layer : others_) bytes += layer.bytes();
  for (const Grid& grid : grids_) bytes += grid.zero_output.size();
  return bytes;
}

LeadingLayers::Scratch::Scratch(const LeadingLayers& layers) : first_(layers.first_) {
  for (size_t i = 0; i < layers.layers_.size(); ++i) {
    const artifact::GridSize& output = layers.layers_[i].output;
    masks_.emplace_back(output.height, output.width);
    computed_.emplace_back(output.height, output.width);
    grids_.emplace_back();
    if (i + 1 < layers.layers_.size()) grids_.back() = layers.grids_[i].zero_output;
    places_.push_back(grids_.back().data());
  }
}

bool LeadingLayers::Evaluate(const scene::Raster& raster, Scratch* scratch, void* grid) const {
  if (!first_.FindNonzeroPixels(raster, &scratch->first_)) return false;
  const CellMask* seen = &scratch->first_.pixels();
  for (size_t i = 0; i < layers_.size(); ++i) {
    std::swap(scratch->masks_[i], scratch->computed_[i]);
    scratch->masks_[i].SetDependent(*seen, layers_[i]);
    seen = &scratch->masks_[i];
    if (i + 1 < layers_.size()) RestoreZeroOutput(i, scratch);
  }
  const std::vector<std::byte>& last = grids_.back().zero_output;
  scratch->places_.back() = static_cast<std::byte*>(grid);
  std::memcpy(grid, last.data(), last.size());
  EvaluateCells(raster, scratch);
  return true;
}

void LeadingLayers::RestoreZeroOutput(size_t layer, Scratch* scratch) const {
  const Grid& grid = grids_[layer];
  const size_t cell_bytes = static_cast<size_t>(grid.channels) * grid.value_bytes;
  const CellMask& computed = scratch->computed_[layer];
  for (int row = 0; row < computed.height(); ++row) {
    computed.ForEachWithout(scratch->masks_[layer], row, [&](int column) {
      const size_t place = static_cast<size_t>(grid.Place(row, column)) * grid.value_bytes;
      std::memcpy(&scratch->grids_[layer][place], &grid.zero_output[place], cell_bytes);
    });
  }
}

void LeadingLayers::EvaluateCells(const scene::Raster& raster, Scratch* scratch) const {
  const Grid* from = &grids_[0];
  std::byte* const first =
      scratch->places_[0] + static_cast<size_t>(from->Place(0, 0)) * from->value_bytes;
  first_.Evaluate(raster, scratch->masks_[0], &scratch->first_, first, from->row_values);
  for (size_t i = 1; i < layers_.size(); ++i) {
    const Grid& to = grids_[i];
    const int stride = layers_[i].stride;
    scratch->cells_.clear();
    for (int row = 0; row < layers_[i].output.height; ++row) {
      scratch->masks_[i].ForEach(row, [&](int column) {
        // The grid's padding offsets the kernel's half width.
        const ptrdiff_t input =
            row * stride * from->row_values + ptrdiff_t{column} * stride * from->channels;
        scratch->cells_.push_back({input, to.Place(row, column)});
      });
    }
    others_[i - 1].Evaluate(scratch->places_[i - 1], from->row_values, scratch->cells_,
                            scratch->places_[i]);
    from = &to;
  }
}

}  // namespace maneuver::inference

// The numbers of all materials of a scene: one row per model, gathered once per vertex.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "scene/description.h"
#include "spectrum/rgb.h"

namespace metrofarm::bsdf {

// Columns are loaded in blocks of four.
inline constexpr int kMaxColumns = 20;

// Each lane's parameters; every model names its own columns. Columns beyond those that the models
// of these lanes have are unspecified.
struct Parameters {
  Float columns[kMaxColumns];
  const float* transmittance = nullptr;  // the scene's TransmittanceTables, for rough plastic

  Float number(int column) const { return columns[column]; }
  Spectrum rgb(int first) const { return {columns[first], columns[first + 1], columns[first + 2]}; }
};

// One model's parameters as written at load, with the textures that multiply them.
struct Row {
  std::array<float, kMaxColumns> values{};
  std::array<int32_t, kMaxColumns> textures{};  // valid where a bit below is set
  uint32_t colour_columns = 0;                  // bit of the first of three columns
  uint32_t scalar_columns = 0;

  void put(int column, float value) { values[column] = value; }
  void put(int first, const scene::Rgb& rgb) {
    for (int k = 0; k < 3; ++k) values[first + k] = rgb[k];
  }
  void put(int first, const scene::Colour& colour) {
    put(first, colour.value);
    if (colour.texture == scene::kNone) return;
    textures[first] = colour.texture;
    colour_columns |= 1U << first;
  }
  void put(int column, const scene::Scalar& scalar) {
    put(column, scalar.value);
    if (scalar.texture == scene::kNone) return;
    textures[column] = scalar.texture;
    scalar_columns |= 1U << column;
  }
};

class ParameterTable {
 public:
  int add(const Row& row);

  bool textured() const { return textured_; }

  // The first `count` columns of each lane's row. Lanes outside `lanes` are unspecified.
  void load(Int row, Mask lanes, int count, Parameters& out) const;

  // Calls colour(column, textures, lanes) and scalar(column, textures, lanes) for every column that
  // a texture multiplies in some of `lanes`.
  template <class Colour, class Scalar>
  void for_each_texture(Int row, Mask lanes, Colour&& colour, Scalar&& scalar) const {
    visit(colour_columns_, row, lanes, colour);
    visit(scalar_columns_, row, lanes, scalar);
  }

 private:
  template <class Visit>
  void visit(const std::vector<int32_t>& columns_of, Int row, Mask lanes, Visit& apply) const {
    const Int columns = gather(columns_of.data(), row, lanes);
    uint32_t rest = 0;
    alignas(32) int32_t words[kLanes];
    columns.store_aligned(words);
    for (int32_t w : words) rest |= static_cast<uint32_t>(w);
    for (; rest != 0; rest &= rest - 1) {
      const int column = __builtin_ctz(rest);
      const Int bit(1 << column);
      const Mask here = lanes & equal(columns & bit, bit);
      apply(column, gather(textures_.data(), row * Int(kMaxColumns) + Int(column), here), here);
    }
  }

  bool textured_ = false;
  std::vector<float> values_;      // kMaxColumns per row
  std::vector<int32_t> textures_;  // kMaxColumns per row
  std::vector<int32_t> colour_columns_, scalar_columns_;
};

}  // namespace metrofarm::bsdf

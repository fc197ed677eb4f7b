// Typed access to the children of one plugin element. What the plugin never asks for is unknown to
// it, and finish() says so: a misspelt parameter must not be ignored.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "scene_file/affine.h"
#include "scene_file/mitsuba/element.h"
#include "scene_file/problems.h"

namespace metrofarm::scene_file::mitsuba {

class Properties {
 public:
  // Resolves the element's <ref> children.
  Properties(const Element& element, const Document& document, Problems& problems);

  const Element& element() const { return element_; }
  Problems& problems() { return problems_; }

  // Each asks for one parameter; `fallback` if the file doesn't have it or after a problem.
  bool has(std::string_view name);
  double number(std::string_view name, double fallback);
  int64_t integer(std::string_view name, int64_t fallback);
  bool boolean(std::string_view name, bool fallback);
  std::string text(std::string_view name, std::string_view fallback);
  Point point(std::string_view name, const Point& fallback);
  // What an <animation> with more than one key says; empty if the parameter is absent or anything
  // else. Who doesn't ask for it cannot move.
  scene::Motion motion(std::string_view name);
  // Identity if absent, or if it is a motion that has been asked for.
  Matrix transform(std::string_view name);

  // Like number and integer; values outside [lowest, highest] are a problem.
  double number_in(std::string_view name, double fallback, double lowest, double highest);
  int64_t integer_in(std::string_view name, int64_t fallback, int64_t lowest, int64_t highest);
  // Whether a value read from the parameter lies in [lowest, highest]; if not, it is a problem.
  bool check_range(std::string_view name, double value, double lowest, double highest);

  // The child with this name, whatever it is, or nullptr. Asks for it.
  const Element* find(std::string_view name);

  // All nested or referenced objects with this tag, named or not, in document order.
  std::vector<const Element*> objects(std::string_view tag);
  // Is there such an object? Doesn't ask for it.
  bool has_object(std::string_view tag) const;
  // The only one of them; more are a problem, none is nullptr.
  const Element* object(std::string_view tag);

  // Accepts parameters that have no effect here; they are not among what is suggested.
  void ignore(std::initializer_list<std::string_view> names);

  // Reports every child that nothing asked for.
  void finish();

 private:
  struct Slot {
    const Element* child;   // what stands in the file: for messages
    const Element* target;  // what it refers to; the same unless child is a <ref>
    std::string name;
    bool asked = false;
    bool moves = false;  // its motion has been asked for, and is one
  };

  const Element* resolve(const Element& ref, const Document& document);
  Slot* slot(std::string_view name);
  const Element* expect(std::string_view name, std::initializer_list<std::string_view> tags);
  void report_unasked(const Slot& slot);

  const Element& element_;
  Problems& problems_;
  std::vector<Slot> slots_;
  std::vector<std::string> known_;
};

// The three components of a <point>, <vector>, <translate>, <scale> or <rotate>: value="x, y, z",
// value="all" or x= y= z= with `missing` for those not given. Problems are reported.
Point read_components(const Element& element, double missing, Problems& problems);

}  // namespace metrofarm::scene_file::mitsuba

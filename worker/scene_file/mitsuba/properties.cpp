#include "scene_file/mitsuba/properties.h"

#include <algorithm>

#include "motion/track.h"
#include "scene_file/mitsuba/transforms.h"
#include "scene_file/names.h"
#include "scene_file/numbers.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

std::string number_text(double value) {
  std::string text = std::to_string(value);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text;
}

double read_number(const Element& element, std::string_view attribute, double missing,
                   Problems& problems) {
  const std::string* text = element.find(attribute);
  if (!text) return missing;
  const std::optional<double> value = parse_double(*text);
  if (!value) {
    problems.fail("\"" + *text + "\" is not a number (attribute \"" + std::string(attribute) +
                      "\" of <" + element.tag + ">)",
                  element.where);
  }
  return value.value_or(missing);
}

}  // namespace

Point read_components(const Element& element, double missing, Problems& problems) {
  const std::string* value = element.find("value");
  if (!value) {
    return {read_number(element, "x", missing, problems),
            read_number(element, "y", missing, problems),
            read_number(element, "z", missing, problems)};
  }
  if (element.find("x") || element.find("y") || element.find("z")) {
    problems.fail("<" + element.tag + "> takes either value= or x= y= z=, not both", element.where);
  }
  const auto numbers = parse_doubles(*value);
  if (!numbers || (numbers->size() != 1 && numbers->size() != 3)) {
    problems.fail("\"" + *value + "\" must be three numbers, as in \"1, 2, 3\", or one for all",
                  element.where);
    return {missing, missing, missing};
  }
  return {(*numbers)[0], (*numbers)[numbers->size() / 2], numbers->back()};
}

Properties::Properties(const Element& element, const Document& document, Problems& problems)
    : element_(element), problems_(problems) {
  for (const Element& child : element.children) {
    const Element* target = child.tag == "ref" ? resolve(child, document) : &child;
    if (!target) continue;
    const std::string& name = child.get("name");
    const TagInfo* info = find_tag(child.tag);
    // Mitsuba 2 writes textures as <spectrum type="bitmap">.
    const bool is_plugin = child.find("type") != nullptr;
    if (name.empty() && info && info->kind == TagKind::kParameter && !is_plugin) {
      problems.fail("<" + child.tag + "> needs a name here", child.where);
    }
    const bool repeated = std::any_of(slots_.begin(), slots_.end(), [&](const Slot& slot) {
      return !name.empty() && slot.name == name;
    });
    if (repeated) {
      problems.fail("parameter \"" + name + "\" of " + element.describe() + " is given twice",
                    child.where);
    }
    slots_.push_back({&child, target, name});
  }
}

const Element* Properties::resolve(const Element& ref, const Document& document) {
  const std::string& id = ref.get("id");
  const auto it = document.by_id.find(id);
  if (it != document.by_id.end()) return it->second;
  std::vector<std::string_view> known;
  for (const auto& [known_id, element] : document.by_id) known.push_back(known_id);
  std::sort(known.begin(), known.end());
  problems_.unsupported("reference to unknown id \"" + id + "\"" + suggestion(id, known),
                        ref.where);
  return nullptr;
}

Properties::Slot* Properties::slot(std::string_view name) {
  if (std::find(known_.begin(), known_.end(), name) == known_.end()) known_.emplace_back(name);
  for (Slot& slot : slots_) {
    if (slot.name != name) continue;
    slot.asked = true;
    return &slot;
  }
  return nullptr;
}

const Element* Properties::find(std::string_view name) {
  const Slot* found = slot(name);
  return found ? found->target : nullptr;
}

bool Properties::has(std::string_view name) {
  return find(name) != nullptr;
}

const Element* Properties::expect(std::string_view name,
                                  std::initializer_list<std::string_view> tags) {
  const Element* child = find(name);
  if (!child || std::find(tags.begin(), tags.end(), child->tag) != tags.end()) return child;
  problems_.unsupported("parameter \"" + std::string(name) + "\" of " + element_.describe() +
                            " must be a <" + std::string(*tags.begin()) + ">, not a <" +
                            child->tag + ">",
                        child->where);
  return nullptr;
}

double Properties::number(std::string_view name, double fallback) {
  const Element* child = expect(name, {"float", "integer"});
  return child ? read_number(*child, "value", fallback, problems_) : fallback;
}

double Properties::number_in(std::string_view name, double fallback, double lowest,
                             double highest) {
  const double value = number(name, fallback);
  return check_range(name, value, lowest, highest) ? value : fallback;
}

bool Properties::check_range(std::string_view name, double value, double lowest, double highest) {
  if (value >= lowest && value <= highest) return true;
  problems_.fail("parameter \"" + std::string(name) + "\" of " + element_.describe() +
                     " must be between " + number_text(lowest) + " and " + number_text(highest) +
                     ", not " + number_text(value),
                 find(name)->where);
  return false;
}

int64_t Properties::integer(std::string_view name, int64_t fallback) {
  const Element* child = expect(name, {"integer"});
  if (!child) return fallback;
  const std::optional<int64_t> value = parse_integer(child->get("value"));
  if (!value) {
    problems_.fail("\"" + child->get("value") + "\" is not an integer (parameter \"" +
                       std::string(name) + "\")",
                   child->where);
  }
  return value.value_or(fallback);
}

int64_t Properties::integer_in(std::string_view name, int64_t fallback, int64_t lowest,
                               int64_t highest) {
  const int64_t value = integer(name, fallback);
  if (value >= lowest && value <= highest) return value;
  problems_.fail("parameter \"" + std::string(name) + "\" of " + element_.describe() +
                     " must be between " + std::to_string(lowest) + " and " +
                     std::to_string(highest) + ", not " + std::to_string(value),
                 find(name)->where);
  return fallback;
}

bool Properties::boolean(std::string_view name, bool fallback) {
  const Element* child = expect(name, {"boolean"});
  if (!child) return fallback;
  const std::string value = lower_case(trim(child->get("value")));
  if (value == "true") return true;
  if (value == "false") return false;
  problems_.fail("\"" + child->get("value") + "\" must be \"true\" or \"false\" (parameter \"" +
                     std::string(name) + "\")",
                 child->where);
  return fallback;
}

std::string Properties::text(std::string_view name, std::string_view fallback) {
  const Element* child = expect(name, {"string"});
  return child ? child->get("value") : std::string(fallback);
}

Point Properties::point(std::string_view name, const Point& fallback) {
  const Element* child = expect(name, {"point", "vector"});
  if (!child) return fallback;
  if (!child->find("value") && (!child->find("x") || !child->find("y") || !child->find("z"))) {
    problems_.fail("<" + child->tag + "> needs x, y and z", child->where);
  }
  return read_components(*child, 0, problems_);
}

Matrix Properties::transform(std::string_view name) {
  const Element* child = expect(name, {"transform", "animation"});
  if (!child) return kIdentity;
  if (child->tag == "transform") return read_transform(*child, problems_);
  if (slot(name)->moves) return kIdentity;
  const scene::Motion motion = read_animation(*child, problems_);
  if (motion.empty()) return kIdentity;
  if (motion.keys.size() == 1) return motion.keys[0].to_world;
  problems_.unsupported("parameter \"" + std::string(name) + "\" of " + element_.describe() +
                            " cannot be an <animation>: this does not move by itself",
                        child->where);
  return motion.keys[0].to_world;
}

scene::Motion Properties::motion(std::string_view name) {
  Slot* found = slot(name);
  if (!found || found->target->tag != "animation") return {};
  scene::Motion motion = read_animation(*found->target, problems_);
  found->moves = motion.keys.size() > 1;
  if (!found->moves) return {};
  if (const std::optional<std::string> problem = motion::Track::problem_with(motion)) {
    problems_.fail(*problem, found->target->where);
    return {};
  }
  if (motion::Track::loses_turns(motion)) {
    problems_.warn(
        "an angle of this <animation> changes by more than half a turn from one <transform> to the "
        "next, but the shorter way is taken; to go all of it, both must have the same <rotate> "
        "steps, with one angle alone that differs",
        found->target->where);
  }
  return motion;
}

std::vector<const Element*> Properties::objects(std::string_view tag) {
  std::vector<const Element*> found;
  for (Slot& slot : slots_) {
    if (slot.target->tag != tag) continue;
    slot.asked = true;
    found.push_back(slot.target);
  }
  return found;
}

bool Properties::has_object(std::string_view tag) const {
  return std::any_of(slots_.begin(), slots_.end(),
                     [&](const Slot& slot) { return slot.target->tag == tag; });
}

const Element* Properties::object(std::string_view tag) {
  const std::vector<const Element*> found = objects(tag);
  if (found.size() > 1) {
    problems_.fail(element_.describe() + " takes only one " + std::string(tag), found[1]->where);
  }
  return found.empty() ? nullptr : found[0];
}

void Properties::ignore(std::initializer_list<std::string_view> names) {
  for (Slot& slot : slots_) {
    if (std::find(names.begin(), names.end(), slot.name) != names.end()) slot.asked = true;
  }
}

void Properties::finish() {
  for (const Slot& slot : slots_) {
    if (!slot.asked) report_unasked(slot);
  }
}

void Properties::report_unasked(const Slot& slot) {
  const std::string& tag = slot.target->tag;
  if (tag == "medium" || tag == "phase" || tag == "volume") {
    problems_.unsupported(problems_.lenient()
                              ? "participating media are not supported; the medium is left out"
                              : "participating media are not supported",
                          slot.child->where);
  } else if (slot.name.empty()) {
    problems_.unsupported(slot.target->describe() + " has no place in " + element_.describe(),
                          slot.child->where);
  } else {
    const std::vector<std::string_view> known(known_.begin(), known_.end());
    problems_.unsupported("unknown parameter \"" + slot.name + "\" of " + element_.describe() +
                              suggestion(slot.name, known),
                          slot.child->where);
  }
}

}  // namespace metrofarm::scene_file::mitsuba

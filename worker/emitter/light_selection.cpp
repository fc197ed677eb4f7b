#include "emitter/light_selection.h"

#include <algorithm>

#include "base/check.h"
#include "emitter/lookup.h"

namespace metrofarm::emitter {
namespace {

// Of primitives, so that a rectangle of two triangles is asked as one light is.
constexpr size_t kFewLights = 2;

constexpr auto kAllSteps = static_cast<int32_t>(kChoiceSteps);
constexpr auto kPerStep = static_cast<float>(1 / kChoiceSteps);

std::vector<LightTree::Leaf> leaves_of(const std::vector<LightSelection::Light>& lights) {
  std::vector<LightTree::Leaf> leaves;
  for (size_t i = 0; i < lights.size(); ++i) {
    if (lights[i].power > 0 && !lights[i].infinitely_far && usable(lights[i].bounds))
      leaves.push_back({lights[i].bounds, static_cast<int32_t>(i)});
  }
  return leaves;
}

}  // namespace

WeightTable::WeightTable(std::span<const double> weights, int32_t skipped)
    : cdf_(weights.size()), pick_(weights.size()) {
  quantize_cdf(weights, cdf_, pick_, skipped);
}

LightChoice WeightTable::choose(Float choice, Mask lanes) const {
  const auto count = static_cast<int32_t>(cdf_.size());
  const Int light = find_in_cdf(cdf_.data(), Int(0), count, choice, lanes).index;
  return {light, probability(light, lanes)};
}

LightSelection::LightSelection(const std::vector<Light>& lights) {
  METROFARM_CHECK(lights.size() < size_t{1} << 22);
  std::vector<LightTree::Leaf> leaves = leaves_of(lights);
  std::vector<double> weights(lights.size());
  double sums[2] = {0, 0};
  for (const Light& light : lights) sums[light.infinitely_far ? 1 : 0] += light.power;
  for (size_t i = 0; i < lights.size(); ++i)
    weights[i] = lights[i].power > 0 ? lights[i].power / sums[lights[i].infinitely_far ? 1 : 0] : 0;
  if (leaves.size() > kFewLights) {
    for (const LightTree::Leaf& leaf : leaves) weights[leaf.light] = 0;
    tree_ = LightTree(std::move(leaves), lights.size());
    const bool alone = std::none_of(weights.begin(), weights.end(), [](double w) { return w > 0; });
    tree_steps_ = alone ? kAllSteps : kAllSteps / 2;
    if (alone) return;
  }
  table_ = WeightTable(weights, tree_steps_);
}

LightChoice LightSelection::choose(Float choice, const Receiver& receiver, Mask lanes) const {
  if (tree_.empty()) return table_.choose(choice, lanes);
  const Mask in_tree = lanes & (choice < Float(static_cast<float>(tree_steps_) * kPerStep));
  const Mask rest = lanes & ~in_tree;
  LightChoice result;
  if (any(rest)) result = table_.choose(choice, rest);
  if (none(in_tree)) return result;
  const Int step = truncate(choice * Float(static_cast<float>(kAllSteps)));
  const LightTree::Choice found = tree_.choose(step, tree_steps_, receiver, in_tree);
  result.light = select(in_tree, found.light, result.light);
  result.probability = select(in_tree, to_float(found.steps) * Float(kPerStep), result.probability);
  return result;
}

Float LightSelection::probability(Int light, const Receiver& receiver, Mask lanes) const {
  const Float listed = table_.empty() ? Float(0.F) : table_.probability(light, lanes);
  if (tree_.empty()) return listed;
  return listed + to_float(tree_.steps_of(light, tree_steps_, receiver, lanes)) * Float(kPerStep);
}

}  // namespace metrofarm::emitter

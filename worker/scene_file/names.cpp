#include "scene_file/names.h"

#include <algorithm>
#include <cctype>
#include <numeric>

namespace metrofarm::scene_file {
namespace {

bool is_upper(char c) {
  return c >= 'A' && c <= 'Z';
}

// Levenshtein distance, by rows.
size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), size_t{0});
  for (size_t i = 0; i < a.size(); ++i) {
    size_t diagonal = row[0];
    row[0] = i + 1;
    for (size_t j = 0; j < b.size(); ++j) {
      const size_t substitution = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({substitution, row[j] + 1, diagonal + 1});
    }
  }
  return row[b.size()];
}

std::string_view nearest(std::string_view name, const std::vector<std::string_view>& candidates) {
  const std::string wanted = lower_case(name.substr(0, 64));
  size_t best_distance = std::max<size_t>(2, wanted.size() / 3) + 1;
  std::string_view best;
  for (std::string_view candidate : candidates) {
    const size_t distance = edit_distance(wanted, lower_case(candidate.substr(0, 64)));
    if (distance < best_distance && distance < candidate.size()) {
      best_distance = distance;
      best = candidate;
    }
  }
  return best;
}

}  // namespace

std::string lower_case(std::string_view text) {
  std::string lower(text);
  for (char& c : lower) {
    if (is_upper(c)) c = static_cast<char>(c - 'A' + 'a');
  }
  return lower;
}

std::string snake_case(std::string_view text) {
  std::string snake;
  for (size_t i = 0; i < text.size(); ++i) {
    if (is_upper(text[i]) && i > 0 && !is_upper(text[i - 1]) && text[i - 1] != '_') snake += '_';
    snake += text[i];
  }
  return lower_case(snake);
}

std::string suggestion(std::string_view name, const std::vector<std::string_view>& candidates) {
  if (candidates.empty()) return "";
  std::string text;
  const std::string_view best = nearest(name, candidates);
  if (!best.empty()) text += "; did you mean \"" + std::string(best) + "\"?";
  constexpr size_t kMaxListed = 24;
  text += best.empty() ? "; supported: " : " (supported: ";
  for (size_t i = 0; i < std::min(candidates.size(), kMaxListed); ++i) {
    if (i > 0) text += ", ";
    text += candidates[i];
  }
  if (candidates.size() > kMaxListed) text += ", ...";
  if (!best.empty()) text += ')';
  return text;
}

}  // namespace metrofarm::scene_file

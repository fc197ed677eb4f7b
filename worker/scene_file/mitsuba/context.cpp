#include "scene_file/mitsuba/context.h"

#include "scene_file/names.h"

namespace metrofarm::scene_file::mitsuba {

void report_unknown_plugin(const Element& element, const std::vector<std::string_view>& supported,
                           std::string_view instead, Problems& problems) {
  const std::string& type = element.get("type");
  if (type.empty()) {
    return problems.fail("<" + element.tag + "> needs a type" + suggestion("", supported),
                         element.where);
  }
  std::string message = element.describe() + " is not supported" + suggestion(type, supported);
  if (problems.lenient()) message += "; " + std::string(instead);
  problems.unsupported(message, element.where);
}

}  // namespace metrofarm::scene_file::mitsuba

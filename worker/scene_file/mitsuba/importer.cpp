#include "scene_file/mitsuba/importer.h"

#include <algorithm>
#include <optional>

#include "scene_file/mitsuba/bsdfs.h"
#include "scene_file/mitsuba/context.h"
#include "scene_file/mitsuba/document.h"
#include "scene_file/mitsuba/emitters.h"
#include "scene_file/mitsuba/integrator.h"
#include "scene_file/mitsuba/sensor.h"
#include "scene_file/mitsuba/shapes.h"

namespace metrofarm::scene_file::mitsuba {
namespace {

class SceneBuilder {
 public:
  SceneBuilder(Context& context, const LoadOptions& options)
      : context_(context),
        options_(options),
        properties_(context.properties_of(context.document.root)) {}

  void build() {
    load_camera();
    for (const Element* element : properties_.objects("bsdf")) load_bsdf(*element, context_);
    for (const Element* element : properties_.objects("emitter")) {
      load_scene_emitter(*element, context_);
    }
    // Definitions for others to refer to; whoever does so says whether it can use them.
    for (std::string_view tag : {"texture", "film", "sampler", "rfilter", "spectrum"}) {
      properties_.objects(tag);
    }
    load_shapes();
    properties_.finish();
    warn_about_unused_lights();
  }

 private:
  void load_camera() {
    if (const Element* integrator = properties_.object("integrator")) {
      load_integrator(*integrator, context_);
    }
    const std::vector<const Element*> sensors = properties_.objects("sensor");
    if (sensors.empty()) {
      return context_.problems.fail("the scene has no <sensor>: it needs one of type perspective",
                                    context_.document.root.where);
    }
    load_sensor(*sensors[0], context_);
    if (sensors.size() > 1) {
      context_.problems.warn("the scene has several sensors; the first one is used",
                             sensors[1]->where);
    }
  }

  void load_shapes() {
    const std::vector<const Element*> shapes = properties_.objects("shape");
    size_t at_once = 0;  // shapes that need no file
    for (size_t i = 0; i < shapes.size() && !context_.problems.failed(); ++i) {
      const size_t queued = context_.meshes.size();
      const std::string& id = shapes[i]->get("id");
      report(at_once, shapes.size(), shapes[i]->describe() + (id.empty() ? "" : " " + id));
      load_shape(*shapes[i], context_);
      if (context_.meshes.size() == queued) ++at_once;
    }
    if (context_.problems.failed()) return;
    const auto report_mesh = [&](size_t done, const std::string& name) {
      report(at_once + done, at_once + context_.meshes.size(), name);
    };
    std::optional<Error> error =
        context_.meshes.load(context_.files, context_.scene.shapes, report_mesh);
    if (error) return context_.problems.fail(std::move(*error));
    if (options_.progress) options_.progress(1, "scene loaded");
  }

  void report(size_t done, size_t all, const std::string& name) {
    if (!options_.progress) return;
    fraction_ = std::max(fraction_, static_cast<double>(done) / static_cast<double>(all));
    options_.progress(fraction_, name);
  }

  void warn_about_unused_lights() {
    for (const Element* element : properties_.objects("emitter")) {
      if (element->get("type") != "area" || context_.attached_emitters.contains(element)) continue;
      context_.problems.warn("this area emitter is not attached to a shape and gives no light",
                             element->where);
    }
  }

  Context& context_;
  const LoadOptions& options_;
  Properties properties_;
  double fraction_ = 0;
};

}  // namespace

Result<scene::SceneDescription> import_scene(const std::filesystem::path& file,
                                             const LoadOptions& options) {
  Problems problems(options.lenient);
  FileAccess files(file, options);
  const Document document = read_document(file, options, files, problems);
  if (problems.failed()) return problems.error();
  Context context{document, files, problems};
  SceneBuilder(context, options).build();
  if (problems.failed()) return problems.error();
  context.scene.warnings = problems.take_warnings();
  return std::move(context.scene);
}

}  // namespace metrofarm::scene_file::mitsuba

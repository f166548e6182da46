#include "formfactor/raster.h"

#include "base/error.h"
#include "base/machine.h"
#include "formfactor/facet_mesh.h"
#include "formfactor/hemicube_rows.h"
#include "formfactor/raster_tables.h"
#include "gpu/batch_size.h"
#include "patch/positions.h"
#include "shaders/hemicube.frag.h"
#include "shaders/hemicube.vert.IMAGES.h"
#include "shaders/hemicube.vert.LAYERED.h"
#include "shaders/hemicube.vert.LAYERED_IMAGES.h"
#include "shaders/hemicube.vert.h"
#include "shaders/hemicube_compact.comp.h"
#include "shaders/hemicube_cull.comp.h"
#include "shaders/hemicube_mask.comp.h"
#include "shaders/hemicube_reduce.comp.MAPPED.h"
#include "shaders/hemicube_reduce.comp.h"
#include "shared/interface.h"

#include <optional>

namespace farol {
namespace {

using shader::toVec4;

// Near distance, and the distance from a facet's plane at which the eye counts as lying in it, in unit coordinates.
// Depth is a float in reversed z, so a tiny near distance costs no precision.
constexpr double kNear = 1e-6;
constexpr double kEdgeOn = 4e-7;      // a few float32 roundings of points at most 0.5 from the centre
constexpr uint32_t kFirstBatch = 16;  // hemicubes: nobody knows yet how long they take

shader::HemicubeFrame frameOf(const HemicubePose& p) {
  return {toVec4(p.origin), toVec4(p.x), toVec4(p.y), toVec4(p.z), toVec4(Vec3(0), 1)};
}

// The mirror itself, and what lies in its plane, is behind the image.
shader::HemicubeFrame frameOf(const MirrorImage& image) {
  const HemicubePose& p = image.pose;
  return {toVec4(p.origin, image.flipped ? 1 : 0), toVec4(p.x), toVec4(p.y), toVec4(p.z),
          toVec4(image.clipNormal, -image.clipDistance - 2 * kEdgeOn)};
}

}  // namespace

struct RasterRowMaker::Impl {
  // One of two batches under way: while the device works on one, the host stores the rows of the other.
  struct Slot {
    gpu::Buffer frames, counts, seen;  // counts: sums or lists; seen: items, for hybrid
    gpu::Buffer parents;               // of images: parent layer and mirror
    gpu::Bindings cullBindings, drawBindings, maskBindings, compactBindings;
    gpu::Commands commands;
    std::vector<Hemicube> hemicubes;
    Stopwatch sinceSubmission;
  };

  Impl(const gpu::Device& d, const FacetSet& f, const PatchSet& p, const RasterOptions& o)
      : device(d),
        facets(f),
        patches(p),
        options(o),
        layout(layoutOf(o.projection, o.resolution)),
        pixels(layout.width * layout.height),
        bins(static_cast<uint32_t>(p.size()) + (o.images != nullptr ? 3 : 2)),
        mostListed(worthListing() ? pixels : 0),
        layers(chooseLayers()),
        size(kFirstBatch, std::min(mostPerHemicube(), layers), layers),
        layered(o.layered && d.info().layeredDrawing),
        clusters(buildClusters(f)),
        clusterCount(static_cast<uint32_t>(clusters.records.size())),
        mesh(buildFacetMesh(f, clusters.order)),
        vertices(gpu::upload(d, "facet vertices", mesh.vertices)),
        indices(gpu::upload(d, "facet indices", mesh.indices)),
        records(gpu::upload(d, "facet records", facetRecords(f, p))),
        binOfItem(gpu::upload(d, "item bins", itemBins(p))),
        deltaFactors(gpu::upload(d, "delta form factors", quantisedFormFactors(o.projection, o.resolution))),
        clusterRecords(gpu::upload(d, "clusters", clusters.records)),
        faceRecords(gpu::upload(d, "faces", faceRecordsOf(layout))),
        visible(d, "visible layers", uint64_t{4} * layout.faces.size() * clusterCount * layers, gpu::Memory::device),
        draws(d, "draws", uint64_t{20} * layout.faces.size() * clusterCount, gpu::Memory::device),
        target(d, "item buffer", layout.width, layout.height, layers, {gpu::Format::uint32}),
        items(d, "items", uint64_t{4} * pixels * layers, gpu::Memory::device),
        sums(d, "row sums", uint64_t{4} * bins * layers, gpu::Memory::device),
        masked(d, "masked items", o.images != nullptr ? uint64_t{4} * pixels * layers : 0, gpu::Memory::device),
        mirrorOfItem(gpu::upload(d, "mirrors of items", itemMirrors(p, o.images))),
        draw(d, "hemicube", vertexShader(), hemicube_frag, {gpu::Format::uint32}, shader::kItemBindingCount,
             sizeof(shader::ItemPush)),
        cull(d, "hemicube culling", hemicube_cull_comp, shader::kCullBindingCount, sizeof(shader::CullPush)),
        reduce(d, "hemicube reduction", isIdentity(p) ? gpu::Spirv(hemicube_reduce_comp) : gpu::Spirv(hemicube_reduce_comp_MAPPED),
               shader::kReduceBindingCount, sizeof(shader::ReducePush)),
        compact(d, "hemicube compaction", hemicube_compact_comp, shader::kCompactBindingCount, sizeof(shader::CompactPush)),
        reduceBindings(d, "hemicube reduction", {o.images != nullptr ? &masked : &items, &deltaFactors, &binOfItem, &sums}),
        hemicubeRows(f, p, options, layout, bins, mostListed) {
    for (const char* name : {"batch A", "batch B"}) {
      gpu::Buffer frames(d, fmt::format("{} frames", name), sizeof(shader::HemicubeFrame) * layers, gpu::Memory::upload);
      gpu::Buffer counts(d, fmt::format("{} rows", name), downloadBytes() * layers, gpu::Memory::download);
      gpu::Bindings cullBindings(d, fmt::format("{} culling", name), {&frames, &clusterRecords, &faceRecords, &visible, &draws});
      gpu::Bindings drawBindings(d, name, {&records, &frames, &visible});
      gpu::Buffer seen(d, fmt::format("{} items", name), o.tree != nullptr ? uint64_t{4} * pixels * layers : 0,
                       gpu::Memory::download);
      gpu::Buffer parents(d, fmt::format("{} images", name), uint64_t{8} * layers, gpu::Memory::upload);
      gpu::Bindings maskBindings(d, fmt::format("{} masking", name), {&items, &mirrorOfItem, &parents, &masked});
      gpu::Bindings compactBindings(d, fmt::format("{} compaction", name), {&sums, &counts});
      slots.push_back({std::move(frames),
                       std::move(counts),
                       std::move(seen),
                       std::move(parents),
                       std::move(cullBindings),
                       std::move(drawBindings),
                       std::move(maskBindings),
                       std::move(compactBindings),
                       gpu::Commands(d, name),
                       {},
                       {}});
    }
    if (o.images != nullptr)
      mask.emplace(d, "hemicube masking", hemicube_mask_comp, shader::kMaskBindingCount, sizeof(shader::MaskPush));
  }

  // Bins that are empty stay on the device where there are many more of them than pixels: each pixel fills one at most.
  bool worthListing() const {
    constexpr uint32_t kEmptyBins = 2;
    return options.lists && options.tree == nullptr && options.images == nullptr && bins >= kEmptyBins * (pixels + 1);
  }
  uint64_t downloadBytes() const {  // per hemicube
    return mostListed > 0 ? uint64_t{8} * (1 + mostListed) : uint64_t{4} * bins;
  }

  // Colour, depth and items per pixel; sums per bin and two downloads; lists of visible clusters.
  uint64_t bytesPerLayer() const {
    const uint64_t seen =
        (options.tree != nullptr ? uint64_t{8} * pixels : 0) + (options.images != nullptr ? uint64_t{4} * pixels : 0);
    return seen + uint64_t{12} * pixels + uint64_t{4} * bins + 2 * downloadBytes() + uint64_t{4} * drawCount();
  }

  uint64_t drawCount() const { return uint64_t{layout.faces.size()} * clusterCountOf(facets); }

  // A hemicube and its images lie in one batch.
  uint32_t mostPerHemicube() const { return options.images != nullptr ? options.images->most() + 1 : 1; }

  gpu::Spirv vertexShader() const {
    if (options.images != nullptr) return layered ? gpu::Spirv(hemicube_vert_LAYERED_IMAGES) : gpu::Spirv(hemicube_vert_IMAGES);
    return layered ? gpu::Spirv(hemicube_vert_LAYERED) : gpu::Spirv(hemicube_vert);
  }

  uint32_t chooseLayers() const {
    const gpu::Limits& limits = device.limits();
    uint64_t count = options.deviceMemory / bytesPerLayer();
    count = std::min<uint64_t>(count, limits.maxImageLayers);
    const uint64_t widest =
        std::max<uint64_t>({pixels, bins, drawCount(), downloadBytes() / 4});  // words per layer of the largest buffer
    count = std::min(count, limits.maxStorageBufferRange / (4 * widest));
    count = std::min<uint64_t>(count, std::max(options.maxBatch, mostPerHemicube()));
    if (count == 0) {
      throw Error("a hemicube of resolution {} with {} patches needs {} bytes on the device; {} are allowed", options.resolution,
                  patches.size(), bytesPerLayer(), options.deviceMemory);
    }
    return static_cast<uint32_t>(count);
  }

  void drawFacets(gpu::Commands& commands, uint32_t face) {
    if (layered)
      commands.drawIndirect(draws, face * clusterCount, clusterCount);
    else
      commands.drawIndexed(static_cast<uint32_t>(mesh.indices.size()));
  }

  void drawLayers(gpu::Commands& commands, uint32_t first, uint32_t count) {
    const auto nothing = static_cast<uint32_t>(patches.cells.size()), backItem = nothing + 1;
    commands.beginRaster(target, first, count, nothing);
    for (uint32_t k = 0; k < layout.faces.size(); ++k) {
      const ProjectionFace& face = layout.faces[k];
      // x in [low, 1] * depth becomes clip.x in [-1, 1] * depth.
      const double scaleX = 2 / (1 - face.low), scaleY = 2 / (1 - face.bottom);
      shader::ItemPush push{toVec4(face.right, scaleX),
                            toVec4(face.up, scaleY),
                            toVec4(face.forward, kNear),
                            toVec4(Vec3(1 - scaleX, 1 - scaleY, kEdgeOn)),
                            first,
                            backItem,
                            0,
                            0};
      commands.viewport(face.x, face.y, face.width, face.height);
      commands.push(push);
      if (facets.hasTwins) {  // back to back at the same depth: fronts come first and equal depths do not replace
        commands.faces(gpu::Faces::front);
        drawFacets(commands, k);
        commands.faces(gpu::Faces::back);
        drawFacets(commands, k);
      } else {
        commands.faces(gpu::Faces::all);
        drawFacets(commands, k);
      }
    }
    commands.endRaster();
  }

  void submit(Slot& slot) {
    const auto count = static_cast<uint32_t>(slot.hemicubes.size());
    const auto frames = slot.frames.as<shader::HemicubeFrame>();
    for (uint32_t k = 0; k < count; ++k) {
      const Hemicube& h = slot.hemicubes[k];
      frames[k] = h.isImage ? frameOf(h.image) : frameOf(poseOf(h, patches.patches[h.patch].normal));
      slot.parents.as<uint32_t>()[2 * k] = h.isImage ? h.parent : shader::kNoCell;
      slot.parents.as<uint32_t>()[2 * k + 1] = h.image.mirror;
    }
    gpu::Commands& commands = slot.commands;
    commands.begin();
    commands.fill(sums, uint64_t{4} * bins * count, 0);
    if (layered) {
      const auto faces = static_cast<uint32_t>(layout.faces.size());
      commands.bind(cull, slot.cullBindings);
      commands.push(shader::CullPush{clusterCount, count, layers, 0});
      commands.dispatch(std::min(clusterCount, device.limits().maxWorkgroupCount), faces);
    }
    commands.bind(draw, slot.drawBindings);
    commands.bindMesh(vertices, indices);
    if (layered) {
      drawLayers(commands, 0, count);
    } else {
      for (uint32_t k = 0; k < count; ++k) drawLayers(commands, k, 1);
    }
    commands.copyColor(target, 0, count, items);
    if (options.images != nullptr) {
      commands.bind(*mask, slot.maskBindings);
      commands.push(shader::MaskPush{pixels, static_cast<uint32_t>(patches.cells.size()) + 2, 0, 0});
      commands.dispatch((pixels + shader::kMaskGroupSize - 1) / shader::kMaskGroupSize, count);
    }
    commands.bind(reduce, reduceBindings);
    commands.push(shader::ReducePush{pixels, bins, 0, 0});
    constexpr uint32_t kPixelsPerGroup = shader::kReduceGroupSize * shader::kReducePixelsPerLane;
    commands.dispatch((pixels + kPixelsPerGroup - 1) / kPixelsPerGroup, count);
    if (mostListed > 0) {
      commands.bind(compact, slot.compactBindings);
      commands.push(shader::CompactPush{bins, mostListed, 0, 0});
      commands.dispatch(count, 1);
      commands.shareWithHost();
    } else {
      commands.copy(sums, slot.counts, uint64_t{4} * bins * count);
    }
    if (options.tree != nullptr) commands.copy(items, slot.seen, uint64_t{4} * pixels * count);
    slot.sinceSubmission = {};
    commands.submit();
  }

  // Stores the rows that the slot's batch completes.
  void collect(Slot& slot, RowStore& store) {
    const Stopwatch wait;
    slot.commands.wait();
    // The device was busy with this batch since it got it, or since the one before was done; for less than that where it
    // had finished before the host asked.
    const double busy = std::min(slot.sinceSubmission.seconds(), sinceLastBatch.seconds());
    constexpr double kAtOnce = 1e-4;
    if (wait.seconds() > kAtOnce || busy < gpu::BatchSize::kSeconds) size.took(static_cast<uint32_t>(slot.hemicubes.size()), busy);
    sinceLastBatch = {};
    hemicubeRows.store({slot.hemicubes, slot.counts.as<const uint32_t>(), slot.seen.as<const uint32_t>()}, store);
  }

  void makeRows(std::span<const uint32_t> wanted, RowStore& store, const std::function<void(size_t)>& done) {
    hemicubeRows.forget();
    size_t batch = 0;
    Slot* busy = nullptr;
    std::vector<Hemicube> next;
    size_t rowsSubmitted = 0, rowsBusy = 0;
    const auto flush = [&](size_t rows) {
      Slot& slot = slots[batch++ % 2];
      slot.hemicubes.swap(next);
      next.clear();
      submit(slot);
      if (busy != nullptr) {
        collect(*busy, store);
        done(rowsBusy);
      }
      busy = &slot;
      rowsBusy = rows;
    };
    for (const uint32_t patch : wanted) {
      const uint64_t seed = mixBits(options.seed * 0x100000001B3ull + patch);
      auto positions = positionsOn(facets, patches, patch, options.positions, seed);
      if (options.positions == 1 && options.exposed != nullptr) positions[0].point = options.exposed->point[patch];
      ++rowsSubmitted;
      for (size_t k = 0; k < positions.size(); ++k) {
        const double turn = options.turned ? 2 * kPi * unitFromBits(mixBits(seed + 2 + k)) : 0.0;
        const Hemicube hemicube{patch, positions[k].point, positions[k].weight, turn, k + 1 == positions.size(), {}, false, kNone};
        if (options.images == nullptr) {
          next.push_back(hemicube);
        } else {
          auto images = options.images->of(poseOf(hemicube, patches.patches[patch].normal));
          images.resize(std::min<size_t>(images.size(), layers - 1));
          if (!next.empty() && next.size() + 1 + images.size() > size.now()) flush(rowsSubmitted - 1);
          const auto base = static_cast<uint32_t>(next.size());
          next.push_back(hemicube);
          for (const MirrorImage& image : images) {
            next.back().last = false;
            next.push_back(hemicube);
            next.back().image = image;
            next.back().isImage = true;
            next.back().parent = base + static_cast<uint32_t>(image.parent + 1);
          }
        }
        if (next.size() >= size.now()) flush(next.back().last ? rowsSubmitted : rowsSubmitted - 1);
      }
    }
    if (!next.empty()) flush(rowsSubmitted);
    if (busy != nullptr) {
      collect(*busy, store);
      done(rowsBusy);
    }
  }

  const gpu::Device& device;
  const FacetSet& facets;
  const PatchSet& patches;
  RasterOptions options;
  ProjectionLayout layout;
  uint32_t pixels, bins, mostListed, layers;  // mostListed: bins of a list; 0: sums of all bins come back
  gpu::BatchSize size;                        // hemicubes per submission
  Stopwatch sinceLastBatch;                   // was done
  bool layered;
  FacetClusters clusters;
  uint32_t clusterCount;
  FacetMesh mesh;
  gpu::Buffer vertices, indices, records, binOfItem, deltaFactors, clusterRecords, faceRecords, visible, draws;
  gpu::RasterTarget target;
  gpu::Buffer items, sums, masked, mirrorOfItem;
  gpu::RasterPipeline draw;
  gpu::ComputePipeline cull, reduce, compact;
  std::optional<gpu::ComputePipeline> mask;  // with images
  gpu::Bindings reduceBindings;
  std::vector<Slot> slots;
  HemicubeRows hemicubeRows;
};

RasterRowMaker::RasterRowMaker(const gpu::Device& device, const FacetSet& facets, const PatchSet& patches,
                               const RasterOptions& options)
    : device_(device), facets_(facets), patches_(patches), options_(options) {
  if (options_.maxBatch == 0) options_.maxBatch = device.limits().maxImageLayers;
  build();
}
RasterRowMaker::~RasterRowMaker() = default;

void RasterRowMaker::build() {
  while (!impl_) {
    try {
      impl_ = std::make_unique<Impl>(device_, facets_, patches_, options_);
    } catch (const gpu::OutOfMemory& e) {
      shrink(e);
    }
  }
}

void RasterRowMaker::shrink(const gpu::OutOfMemory& why) {
  impl_.reset();
  const uint32_t least = options_.images != nullptr ? options_.images->most() + 1 : 1;
  if (options_.maxBatch <= least) {
    throw Error(
        "{}: the device has no room for one hemicube of resolution {} with {} patches; ask for a lower --resolution, "
        "or --method rays",
        why.what(), options_.resolution, patches_.size());
  }
  options_.maxBatch = std::max(options_.maxBatch / 2, least);
}

void RasterRowMaker::makeRows(std::span<const uint32_t> patches, RowStore& store, const std::function<void(size_t)>& done) {
  for (size_t first = 0;;) {
    const size_t base = first;
    try {
      return impl_->makeRows(patches.subspan(base), store, [&](size_t rows) {
        first = base + rows;
        done(first);
      });
    } catch (const gpu::OutOfMemory& e) {  // others may use the device as well, and some drivers allocate when they draw
      shrink(e);
      build();
    }
  }
}

uint32_t RasterRowMaker::batchSize() const { return impl_->layers; }
uint64_t RasterRowMaker::deviceBytes() const { return impl_->bytesPerLayer() * impl_->layers; }

}  // namespace farol

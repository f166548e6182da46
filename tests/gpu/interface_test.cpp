#include "shared/interface.h"

#include "raster_run.h"
#include "shaders/interface_echo.comp.h"

#include <cstring>
#include <gtest/gtest.h>

namespace farol::test {
namespace {

// Sizes cross the workgroup of 64.
TEST(SharedStructs, AreTheSameBytesInBothLanguages) {
  const gpu::ComputePipeline echo(device(), "echo", interface_echo_comp, 4, 0);
  for (const size_t count : {size_t{1}, size_t{63}, size_t{64}, size_t{65}, size_t{1000}}) {
    std::vector<shader::FacetRecord> facets(count);
    std::vector<shader::HemicubeFrame> frames(count);
    const auto fill = [](auto& v) {
      auto* bytes = reinterpret_cast<uint32_t*>(v.data());
      for (size_t k = 0; k < v.size() * sizeof(v[0]) / 4; ++k)
        bytes[k] = 0x3F000000u + static_cast<uint32_t>(k);  // also fine floats
    };
    fill(facets);
    fill(frames);
    const gpu::Buffer facetsIn = gpu::upload(device(), "facets in", facets), framesIn = gpu::upload(device(), "frames in", frames);
    const gpu::Buffer facetsOut(device(), "facets out", facets.size() * sizeof(facets[0]), gpu::Memory::device);
    const gpu::Buffer framesOut(device(), "frames out", frames.size() * sizeof(frames[0]), gpu::Memory::device);
    const gpu::Buffer facetsBack(device(), "facets back", facetsOut.bytes(), gpu::Memory::download);
    const gpu::Buffer framesBack(device(), "frames back", framesOut.bytes(), gpu::Memory::download);
    const gpu::Bindings bindings(device(), "echo", {&facetsIn, &framesIn, &facetsOut, &framesOut});
    gpu::Commands commands(device(), "echo");
    commands.begin();
    commands.bind(echo, bindings);
    commands.dispatch(static_cast<uint32_t>((count + 63) / 64), 1);
    commands.copy(facetsOut, facetsBack, facetsOut.bytes());
    commands.copy(framesOut, framesBack, framesOut.bytes());
    commands.submit();
    commands.wait();

    EXPECT_EQ(std::memcmp(facetsBack.mapped(), facets.data(), facets.size() * sizeof(facets[0])), 0) << count;
    EXPECT_EQ(std::memcmp(framesBack.mapped(), frames.data(), frames.size() * sizeof(frames[0])), 0) << count;
  }
}

}  // namespace
}  // namespace farol::test

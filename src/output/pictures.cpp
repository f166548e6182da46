#include "base/error.h"
#include "base/output_file.h"
#include "output/output.h"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfOutputFile.h>
#include <stb_image_write.h>

namespace farol {

void writePng(const std::string& path, uint32_t width, uint32_t height, const std::vector<uint8_t>& srgb) {
  OutputFile file(path);
  const auto sink = [](void* to, void* data, int size) {
    static_cast<std::ostream*>(to)->write(static_cast<const char*>(data), size);
  };
  const int w = static_cast<int>(width), h = static_cast<int>(height);
  if (stbi_write_png_to_func(sink, &file.stream(), w, h, 3, srgb.data(), 3 * w) == 0)
    throw Error("cannot write {}: encoding failed", path);
  file.commit();
}

void writeExr(const std::string& path, const Image& image, double scale) {
  std::vector<float> scaled(image.rgb);
  for (float& v : scaled) v = static_cast<float>(static_cast<double>(v) * scale);
  OutputFile file(path);
  file.closeStream();
  try {
    Imf::Header header(static_cast<int>(image.width), static_cast<int>(image.height));
    Imf::FrameBuffer buffer;
    const char* names[3] = {"R", "G", "B"};
    for (size_t c = 0; c < 3; ++c) {
      header.channels().insert(names[c], Imf::Channel(Imf::FLOAT));
      buffer.insert(names[c], Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(scaled.data() + c), 3 * sizeof(float),
                                         3 * sizeof(float) * image.width));
    }
    Imf::OutputFile out(file.temporaryPath().c_str(), header);
    out.setFrameBuffer(buffer);
    out.writePixels(static_cast<int>(image.height));
  } catch (const std::exception& e) {
    throw Error("cannot write {}: {}", path, e.what());
  }
  file.commit();
}

}  // namespace farol

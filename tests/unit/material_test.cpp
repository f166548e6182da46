#include "scene/material.h"

#include <gtest/gtest.h>

namespace farol {
namespace {

// 2 x 1 texels: black, white.
Texture checker(Wrap wrap) { return {"checker", 2, 1, {0, 0, 0, 255, 255, 255, 255, 255}, wrap, wrap, false}; }

TEST(Texture, DecodesSrgbBeforeFiltering) {
  Texture t = checker(Wrap::clamp);
  EXPECT_NEAR(t.sample({0.5, 0.5}, true)[0], 0.5, 1e-12);  // half of linear black and white
  t.rgba[0] = t.rgba[4] = 188;                             // 0.5 in sRGB is about code 188
  EXPECT_NEAR(t.sample({0.5, 0.5}, true)[0], 0.5029, 1e-4);
  EXPECT_NEAR(t.sample({0.5, 0.5}, false)[0], 188 / 255.0, 1e-12);
}

TEST(Texture, WrapsAsItsSamplerSays) {
  EXPECT_NEAR(checker(Wrap::clamp).sample({1.4, 0.5}, true)[0], 1, 1e-12);
  EXPECT_NEAR(checker(Wrap::repeat).sample({1.25, 0.5}, true)[0], 0, 1e-12);
  EXPECT_NEAR(checker(Wrap::mirror).sample({1.25, 0.5}, true)[0], 1, 1e-12);
  EXPECT_NEAR(checker(Wrap::repeat).sample({-0.25, 0.5}, true)[0], 1, 1e-12);
}

TEST(TextureUse, ScalesThenRotatesThenShifts) {
  TextureUse use;
  use.scale = {2, 3};
  use.rotation = kPi / 2;
  use.offset = {0.1, 0.2};
  const Vec2 uv = use.transform({1, 1});  // (2,3) turned by 90 degrees counter-clockwise in the picture: (3,-2)
  EXPECT_NEAR(uv.x, 3.1, 1e-12);
  EXPECT_NEAR(uv.y, -1.8, 1e-12);
}

TEST(Material, SplitsMetalByRoughness) {
  Material m;
  m.baseColor = Rgb(0.8);
  m.metallic = 0.5;
  m.roughness = 0.1;
  Optics o = m.evaluate({}, {});
  EXPECT_NEAR(o.specular.r, 0.4, 1e-12);
  EXPECT_NEAR(o.diffuse.r, 0.4, 1e-12);
  m.roughness = 0.9;  // rough metal counts as diffuse
  o = m.evaluate({}, {});
  EXPECT_NEAR(o.specular.r, 0, 1e-12);
  EXPECT_NEAR(o.diffuse.r, 0.8, 1e-12);
}

TEST(Material, SplitsTransmission) {
  Material m;
  m.baseColor = Rgb(0.8);
  m.metallic = 0;
  m.transmission = 0.25;
  const Optics o = m.evaluate({}, {});
  EXPECT_NEAR(o.diffuse.r, 0.6, 1e-12);
  EXPECT_NEAR(o.transmission.r, 0.2, 1e-12);
}

TEST(Material, IsReplacedByExactValues) {
  Material m;
  m.emission = Rgb(5);
  m.exactDiffuse = Rgb(0.25);
  m.exactEmission = Rgb(1);
  const Optics o = m.evaluate({}, {});
  EXPECT_EQ(o.diffuse, Rgb(0.25));
  EXPECT_EQ(o.specular, Rgb(0));
  EXPECT_EQ(o.emission, Rgb(1));
}

}  // namespace
}  // namespace farol

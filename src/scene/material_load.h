// Materials and textures of a glTF document.
#pragma once

#include "base/log.h"
#include "scene/document.h"
#include "scene/material.h"

#include <tiny_gltf.h>
#include <vector>

namespace farol {

// One Material per glTF material, then the default material as the last one. Throws Error naming the
// material when a reflectance or emission is outside its range.
std::vector<Material> loadMaterials(const Document& document, Log& log);

// One Texture per glTF texture; throws Error when an image is missing or of an unknown layout.
std::vector<Texture> loadTextures(const Document& document, const tinygltf::Model& model);

}  // namespace farol

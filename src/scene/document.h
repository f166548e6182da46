// A glTF file's JSON and binary parts, checked before tinygltf sees them: tinygltf checks neither
// bounds, nor indices, nor cycles, nor where a path leads.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace farol {

struct Document {
  std::string path;
  std::vector<unsigned char> bytes;  // the whole file
  bool binary = false;               // GLB
  nlohmann::json json;
};

// Reads the file and checks its structure: container, required extensions, every index, every byte
// range, every URI. Throws Error naming the file and the object.
Document readDocument(const std::string& path);

}  // namespace farol

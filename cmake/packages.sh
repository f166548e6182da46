# Installs the Debian packages that farol needs, those that are missing only. Sourced by the scripts beside it.

farol_packages="build-essential ccache clang clang-format cmake glslang-tools gnuplot-nox libbenchmark-dev libcli11-dev
 libeigen3-dev libembree-dev libdeflate-dev libfmt-dev libglm-dev libgmock-dev libgtest-dev libjemalloc-dev
 libopenexr-dev libstb-dev libtbb-dev libtinygltf-dev libvulkan-dev libvulkan-volk-dev libzip-dev mesa-vulkan-drivers
 ninja-build nlohmann-json3-dev pkg-config python3-numpy python3-scipy spirv-tools zlib1g-dev vulkan-validationlayers
 $farol_more_packages"

farol_missing=""
for package in $farol_packages; do
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q "ok installed" || farol_missing="$farol_missing $package"
done
if [ -n "$farol_missing" ]; then
  echo "installing:$farol_missing"
  as_root=""
  [ "$(id -u)" -eq 0 ] || as_root="sudo"
  $as_root apt-get update -qq
  DEBIAN_FRONTEND=noninteractive $as_root apt-get install -y -qq --no-install-recommends $farol_missing > /dev/null
fi

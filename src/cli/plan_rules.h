// What a plan for a tolerance and its refinements go by alike.
#pragma once

#include "cli/tolerance.h"

namespace farol {

// Predictions aim below the tolerance: estimates scatter.
inline constexpr double kMargin = 0.78;
inline constexpr uint32_t kLeastShadowRays = 8;
inline constexpr size_t kPicturePatches = 4000;  // a picture shows every patch

// Patches of several sizes must stay below a share of what those of one size cost in time or number; their trial costs some of it.
inline constexpr double kWorthAdapting = 0.7, kWorthATrial = 0.5;

// Where the light is known and the options leave the patches free.
bool mayAdapt(const Options& options);
bool wantsPicture(const Options& options);
// Whether options decide how many samples a row has.
bool givesSamples(const Options& options, const MethodSpec& spec);

// What --adapt would be given for such a tolerance.
Options adaptingOptions(const Options& given, const Setting& setting);
bool isUsable(const Adapting& adapting, const Options& options, const Scene& scene, const FacetSet& facets);

// As options, with the number that these make.
std::string patchesText(const TolerancePlan& plan, double patches);
std::string clusterText(const TolerancePlan& plan);

}  // namespace farol

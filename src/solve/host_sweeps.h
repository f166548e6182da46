// Jacobi sweeps, Gauss-Seidel sweeps and conjugate residuals on the processor. Internal to this room and its benchmark.
#pragma once

#include "solve/solver.h"
#include "solve/system.h"

#include <functional>

namespace farol {

class HostSweeps {
 public:
  HostSweeps(const System& system, const PatchSet& patches);

  // What error is small enough, asked between sweeps with their sum and number so far.
  using Goal = std::function<double(const Channels& sum, size_t sweeps)>;
  // Until what the remaining sweeps would add is well below the goal, or changes have stopped to shrink.
  Reflections reflections(SolverKind kind, const Channels& r, size_t mostSweeps, const Goal& goal);

 private:
  Reflections conjugateResiduals(const Channels& r, size_t mostSweeps, const Goal& goal);

  // One sweep of d = r + rho F d; returns the largest change.
  double jacobi(const Channels& r, Field& d);
  double gaussSeidel(const Channels& r, Field& d);

  const System& system_;
  Channels weights_;  // exposed area / rho, in which rho F is self-adjoint; 0 for what is black
};

}  // namespace farol

// The linear system of the solve, (I - rho F) B = E + rho S, and what sweeps need from it. Internal to this room.
#pragma once

#include "formfactor/form_factors.h"
#include "light/direct.h"

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace farol {

// N x 3, a column per channel: the three systems are advanced together and share every load of F.
using Channels = Eigen::Matrix<double, Eigen::Dynamic, 3>;

inline double largest(const Channels& v) { return v.size() > 0 ? v.cwiseAbs().maxCoeff() : 0.0; }

// What sums over F read a field in: floats are read faster (gather.h), and are enough where a residual in double corrects what
// comes of it, or where a variance is told.
enum class Reading { inDouble, inFloat };

// A value per patch and channel, kept in the two orders that dense rows and lists read fastest. Channels that are alike are
// kept, and gathered, once.
class Field {
 public:
  explicit Field(Channels values, Reading reading = Reading::inDouble);
  void assign(const Channels& values, Reading reading);
  void set(Eigen::Index i, const Eigen::RowVector3d& value);
  void add(const Channels& change);
  void readIn(Reading reading);
  const Channels& columns() const { return columns_; }
  bool alike() const { return alike_; }

  // Values as F reads them: `columns` [3 x patches], or one where channels are alike; `packed` [patches + 1] x 4, or one.
  template <typename Number>
  struct Read {
    const Number* columns;
    const Number* packed;
    double scale;  // they are to be multiplied by: a power of two that brings floats near 1
  };
  // `use(Read<double>)` or `use(Read<float>)`.
  template <typename Use>
  void read(Use&& use) const {
    if (reading_ == Reading::inDouble)
      use(Read<double>{columns_.data(), packed_.data(), 1.0});
    else
      use(Read<float>{floats_.data(), packedFloats_.data(), scale_});
  }

 private:
  void pack();
  void pack(Eigen::Index i);
  Channels columns_;
  Reading reading_;
  bool alike_ = false;
  std::vector<double> packed_;
  double scale_ = 1;
  std::vector<float> floats_, packedFloats_;
};

// sum_j F_ij b_j of at most kRowsAtOnce patches, in `sums` one after the other.
void gather(const FormFactorMatrix& f, std::span<const size_t> patches, const Field& b, Eigen::RowVector3d* sums);

class System {
 public:
  System(const FormFactorMatrix& f, const PatchSet& patches, const DirectLight& direct, const Rgb& sky);

  // Where patches reflect all channels alike and all light has one colour, all channels become those of the brightest, and
  // that colour is returned, relative to it: what is solved is to be multiplied by it.
  std::optional<Rgb> makeOneColour();

  Channels start() const { return emission + reflectance.cwiseProduct(source); }
  const FormFactorMatrix& factors() const { return f_; }

  void gather(std::span<const size_t> patches, const Field& b, Eigen::RowVector3d* sums) const {
    farol::gather(f_, patches, b, sums);
  }
  Eigen::RowVector3d gather(size_t i, const Field& b) const {
    Eigen::RowVector3d sum;
    gather(std::span(&i, 1), b, &sum);
    return sum;
  }

  // What patch i's radiosity should be where the others send `gathered`.
  Eigen::RowVector3d updated(Eigen::Index i, const Eigen::RowVector3d& gathered) const {
    return emission.row(i) + reflectance.row(i).cwiseProduct(source.row(i) + gathered);
  }

  // E + rho (S + F b) - b over the reflecting patches; zero elsewhere. Their F b goes to `gathered`.
  Channels residualOf(const Field& b, Channels& gathered) const;
  // rho F v over the reflecting patches: one Jacobi sweep applied to a difference.
  Channels reflectOnce(const Field& v) const;

  Channels emission, reflectance, source;  // emission: without emitters apart; source: irradiance without F
  // Black patches have B = E: they stay out of the iteration.
  std::vector<size_t> reflecting;
  // Largest rho_i / (1 - s_i - t_i) sum_j F_ij (1 - s_j - t_j), with the mirror and transmission shares s and t: no sweep
  // multiplies the largest value of B / (1 - s - t) by more.
  double bound = 0;
  size_t worstRow = 0;  // where it is reached

 private:
  template <typename Use>
  void gatherAll(const Field& b, Use&& use) const;  // use(i, sum) for every reflecting patch, on all cores

  const FormFactorMatrix& f_;
};

// The factor by which a Jacobi sweep reduces the residual r: what it does to the largest value, and to the norm with
// weights A / rho (of the worst channel), in which rho F is self-adjoint: the spectral radius is not below that.
struct Contraction {
  double ofLargest = 0, ofNorm = 0;
};
Contraction contractionOn(const System& s, const PatchSet& patches, const Channels& r);

// Calls `use(part, place)` for parts of at most kRowsAtOnce patches, on all cores.
void forParts(std::span<const size_t> patches, const std::function<void(std::span<const size_t>, size_t)>& use);

// Corrections to a solution with the residual r: what sweeps add to it after r itself.
struct Reflections {
  Channels sum;                 // rho F r + (rho F)^2 r + ...
  std::vector<double> changes;  // largest, of each sweep; of r itself first
  double radius = 0;            // spectral radius of rho F, where the method has seen it
  bool stuck = false;           // it gets no further
};
// Sweeps that are still missing until what the remaining ones add is below `target`; 0: enough, or changes have stopped
// to shrink. Judged by the last two changes and by those of eight sweeps ago.
double sweepsMissing(std::span<const double> changes, double target);

}  // namespace farol

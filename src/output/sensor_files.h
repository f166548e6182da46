// Files of sensors: points to read irradiance at.
#pragma once

#include "solve/sensors.h"

#include <string>

namespace farol {

// A line per sensor, `x,y,z,nx,ny,nz`, or per grid of nu x nv sensors at the centres of its cells, spanned by u and v
// from a corner, with the normal u x v: `grid,x,y,z,ux,uy,uz,vx,vy,vz,nu,nv`. Lengths in scene units. A first line of
// names, empty lines and lines that begin with # are left out. Throws Error naming the file and line.
std::vector<Sensor> loadSensors(const std::string& path);

// x,y,z,nx,ny,nz,H_r,H_g,H_b,err per sensor.
void writeSensorReadings(const std::string& path, std::span<const Sensor> sensors, std::span<const SensorReading> readings);

}  // namespace farol

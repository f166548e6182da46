#include "base/error.h"
#include "base/output_file.h"
#include "chart/chart.h"

#include <cmath>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

namespace farol {
namespace {

std::string quoted(const std::string& text) { return text.find_first_of(",\"") == std::string::npos ? text : "\"" + text + "\""; }

void writeCsv(const std::string& path, const Chart& chart) {
  OutputFile file(path);
  fmt::print(file.stream(),
             "series,method,patches,seconds,cpu_seconds,row_seconds,light_seconds,repeats,sweeps,row_error,samples_per_patch,error_"
             "H,noise,front,options\n");
  for (const ChartPoint& p : chart.points) {
    fmt::print(file.stream(), "{},{},{},{:.6g},{:.6g},{:.6g},{:.6g},{},{},{:.6g},{:.6g},{:.6g},{:.6g},{},{}\n", quoted(p.series),
               quoted(p.method), p.patches, p.seconds, p.cpuSeconds, p.rowSeconds, p.lightSeconds, p.repeats, p.sweeps, p.rowError,
               p.samplesPerPatch, p.error, p.noise, p.onFront ? 1 : 0, quoted(p.options));
  }
  file.commit();
}

void writeJson(const std::string& path, const Chart& chart) {
  using nlohmann::json;
  json points = json::array(), laws = json::array();
  for (const ChartPoint& p : chart.points) {
    points.push_back({{"series", p.series},
                      {"method", p.method},
                      {"options", p.options},
                      {"patches", p.patches},
                      {"seconds", p.seconds},
                      {"cpu_seconds", p.cpuSeconds},
                      {"row_seconds", p.rowSeconds},
                      {"light_seconds", p.lightSeconds},
                      {"repeats", p.repeats},
                      {"sweeps", p.sweeps},
                      {"row_error", p.rowError},
                      {"samples_per_patch", p.samplesPerPatch},
                      {"error_H", p.error},
                      {"noise", p.noise},
                      {"front", p.onFront}});
  }
  for (const ErrorLaw& l : chart.laws)
    laws.push_back({{"series", l.series}, {"points", l.points}, {"constant", l.constant}, {"exponent", l.exponent}});
  const json all = {
      {"scene", chart.scene},
      {"machine", chart.machine},
      {"time_asked", chart.timeAsked},
      {"complete", chart.complete},
      {"seconds_on_top", chart.otherSeconds},
      {"reference",
       {{"seconds", chart.referenceSeconds}, {"paths_per_cell", chart.referencePaths}, {"standard_error", chart.referenceError}}},
      {"points", points},
      {"laws", laws}};
  OutputFile file(path);
  file.stream() << all.dump(1) << "\n";
  file.commit();
}

// Gnuplot's text without its special characters.
std::string plain(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '\'' || c == '"' || c == '\\' || c == '`' || c == '\n') continue;
    out += c;
  }
  return out;
}

using Series = std::map<std::string, std::vector<const ChartPoint*>>;

// Points of a series that no other of its points beats, by time: what its line runs through.
std::vector<const ChartPoint*> ownFront(std::vector<const ChartPoint*> points, double ChartPoint::*seconds,
                                        double ChartPoint::*error) {
  std::sort(points.begin(), points.end(), [&](const ChartPoint* a, const ChartPoint* b) { return a->*seconds < b->*seconds; });
  std::vector<const ChartPoint*> front;
  for (const ChartPoint* p : points) {
    if (p->*error > 0 && (front.empty() || p->*error < front.back()->*error)) front.push_back(p);
  }
  return front;
}

// One panel: every point small, a line per series through its own front.
std::string panel(const Series& series, double ChartPoint::*seconds, double ChartPoint::*error, const std::string& before) {
  constexpr const char* kColours[] = {"#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00",
                                      "#56B4E9", "#000000", "#8C564B", "#7F7F7F", "#BCBD22"};
  constexpr int kMarks[] = {7, 5, 9, 11, 13, 6, 4, 8, 10, 12};
  std::string plot = "plot ", data;
  plot += before;
  size_t k = 0;
  for (const auto& [name, points] : series) {
    const char* colour = kColours[k % std::size(kColours)];
    const int mark = kMarks[k % std::size(kMarks)];
    ++k;
    std::string all, front;
    for (const ChartPoint* p : points) {
      if (p->*error > 0) all += fmt::format("{} {}\n", p->*seconds, 100 * p->*error);
    }
    for (const ChartPoint* p : ownFront(points, seconds, error)) front += fmt::format("{} {}\n", p->*seconds, 100 * p->*error);
    if (front.empty()) continue;
    plot += fmt::format(
        "'-' with points pt {} ps 0.45 lc rgb '{}' notitle, '-' with linespoints lw 2 pt {} ps 0.9 lc rgb '{}' title '{}', ", mark,
        colour, mark, colour, plain(name));
    data.append(all).append("e\n").append(front).append("e\n");
  }
  return plot.substr(0, plot.size() - 2) + "\n" + data;
}

std::string script(const Chart& chart, const std::string& terminal, const std::string& output) {
  Series series, rows;
  std::vector<const ChartPoint*> front;
  for (const ChartPoint& p : chart.points) {
    series[p.series].push_back(&p);
    if (p.rowError > 0) rows[p.series].push_back(&p);
    if (p.onFront && p.error > 0) front.push_back(&p);
  }
  std::sort(front.begin(), front.end(), [](const ChartPoint* a, const ChartPoint* b) { return a->seconds < b->seconds; });
  std::string text = fmt::format("set terminal {}\nset output '{}'\n", terminal, output);
  text += "set encoding utf8\nset multiplot layout 1,2\n";
  text += fmt::format("set label 1 '{}' at screen 0.012,0.965 font ',17' noenhanced\n",
                      plain(std::filesystem::path(chart.scene).filename().string()));
  text +=
      fmt::format("set label 2 '{}' at screen 0.012,0.93 font ',11' textcolor rgb '#555555' noenhanced\n", plain(chart.machine));
  text +=
      "set tmargin at screen 0.86\nset bmargin at screen 0.1\nset logscale xy\nset grid xtics ytics mytics lc rgb '#DDDDDD', lc "
      "rgb '#EEEEEE'\n"
      "set xlabel 'seconds'\nset format y '%g %%'\nset format x '%g'\nset border lc rgb '#888888'\n"
      "set key outside right top vertical Left reverse samplen 1.5 spacing 1.15 font ',11'\n";
  text += "set title 'Error of irradiance H (rms, of its mean) against time of form factors, light and solve' font ',12'\n";
  text += "set lmargin at screen 0.06\nset rmargin at screen 0.45\n";
  double noise = 0;
  for (const ChartPoint& p : chart.points) noise = std::max(noise, p.noise);
  std::string before, data;
  if (front.size() > 1) {
    before = "'-' with lines lw 11 lc rgb '#DDDDDD' title 'best of all', ";
    for (const ChartPoint* p : front) data += fmt::format("{} {}\n", p->seconds, 100 * p->error);
    data += "e\n";
  }
  if (noise > 0) before += fmt::format("{} with lines dt 3 lw 1.5 lc rgb '#888888' title 'not resolved below', ", 100 * noise);
  std::string first = panel(series, &ChartPoint::seconds, &ChartPoint::error, before);
  first.insert(first.find('\n') + 1, data);
  text += "set key at screen 0.46,0.86 left top\n" + first;
  text += "unset label 1\nunset label 2\nset title 'Error of rows of F (L1) against time of rows' font ',12'\n";
  text += "set lmargin at screen 0.67\nset rmargin at screen 0.985\nunset key\n";
  if (!rows.empty()) text += panel(rows, &ChartPoint::rowSeconds, &ChartPoint::rowError, "");
  return text + "unset multiplot\nset output\n";
}

void runGnuplot(const std::string& text) {
  std::signal(SIGPIPE, SIG_IGN);  // a shell that finds no gnuplot reads nothing
  std::FILE* pipe = popen("gnuplot > /dev/null", "w");
  if (pipe == nullptr) throw Error("gnuplot cannot be started");
  std::fwrite(text.data(), 1, text.size(), pipe);
  const int status = pclose(pipe);
  if (status != 0) throw Error("gnuplot, which draws charts, is missing or failed (status {}); the data are written", status);
}

std::string htmlTable(const Chart& chart) {
  std::string rows;
  std::vector<const ChartPoint*> sorted;
  for (const ChartPoint& p : chart.points) sorted.push_back(&p);
  std::sort(sorted.begin(), sorted.end(), [](const ChartPoint* a, const ChartPoint* b) { return a->seconds < b->seconds; });
  for (const ChartPoint* p : sorted) {
    rows += fmt::format("<tr{}><td>{}</td><td>{}</td><td>{:.4f}</td><td>{:.3f} %</td><td><code>{}</code></td></tr>\n",
                        p->onFront ? " class=\"front\"" : "", p->series, p->patches, p->seconds, 100 * p->error, p->options);
  }
  return rows;
}

}  // namespace

void writeChart(const std::string& path, const Chart& chart) {
  writeCsv(besideChart(path, ".csv"), chart);
  writeJson(besideChart(path, ".json"), chart);
  if (chart.points.empty())
    throw Error("{}: no setting was measured in {} seconds: there is nothing to draw; allow more with --time", chart.scene,
                chart.timeAsked);
  const bool png = path.ends_with(".png");
  OutputFile file(path);
  file.closeStream();
  runGnuplot(script(chart,
                    png ? "pngcairo size 1500,640 background rgb 'white' font 'sans,11'"
                        : "svg size 1500,640 background rgb 'white' font 'sans,11'",
                    file.temporaryPath()));
  if (path.ends_with(".html")) {
    std::ifstream drawn(file.temporaryPath());
    std::stringstream svg;
    svg << drawn.rdbuf();
    const std::string text = svg.str();
    std::ofstream page(file.temporaryPath(), std::ios::trunc);
    fmt::print(page,
               "<!DOCTYPE html>\n<html lang=\"en\"><meta "
               "charset=\"utf-8\"><title>{}</title>\n<style>body{{font-family:sans-serif;margin:1em}} td{{padding:0 1em 0 0}} "
               "tr.front{{font-weight:bold}}</style>\n{}\n<table><tr><th>series</th><th>patches</th><th>seconds</th><th>error of "
               "H</th><th>farol solve ...</th></tr>\n{}</table></html>\n",
               chart.scene, text.substr(text.find("<svg")), htmlTable(chart));
  }
  file.commit();
}

}  // namespace farol

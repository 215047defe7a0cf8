// The OpenSubdiv program of peers.py:  opensubdiv SCHEME PART FILE
//
// SCHEME: 0 Catmull-Clark, 1 Loop. PART: 0 everything (topology, positions in double precision, list of faces), 1 only positions. FILE:
// FILE_v.npy and FILE_f.npy in the folder PEERS_DATA are the vertices and faces of the mesh. Does the work once and prints the sum of
// the squares of all x. Then does it once for each line of standard input, and prints the milliseconds.
#include <opensubdiv/far/primvarRefiner.h>
#include <opensubdiv/far/topologyDescriptor.h>
#include <opensubdiv/far/topologyRefinerFactory.h>

#include <chrono>
#include <iostream>
#include <memory>

#include "bench.h" // in shared/peers/cpp: reads .npy
using namespace OpenSubdiv;

static const int LEVELS = 4;

struct Point {
  double x[3];
  void Clear(void * = nullptr) { x[0] = x[1] = x[2] = 0; }
  void AddWithWeight(const Point &other, double weight) {
    for (int i = 0; i < 3; i++) x[i] += weight * other.x[i];
  }
};

struct Mesh {
  Npy vertices, faces;
};

static std::unique_ptr<Far::TopologyRefiner> refine(const Mesh &mesh, bool loop) {
  std::vector<int> sides(mesh.faces.shape[0], int(mesh.faces.shape[1]));
  Far::TopologyDescriptor descriptor;
  descriptor.numVertices = int(mesh.vertices.shape[0]), descriptor.numFaces = int(mesh.faces.shape[0]);
  descriptor.numVertsPerFace = sides.data(), descriptor.vertIndicesPerFace = mesh.faces.i.data();
  typedef Far::TopologyRefinerFactory<Far::TopologyDescriptor> Factory;
  std::unique_ptr<Far::TopologyRefiner> refiner(
      Factory::Create(descriptor, Factory::Options(loop ? Sdc::SCHEME_LOOP : Sdc::SCHEME_CATMARK, Sdc::Options())));
  Far::TopologyRefiner::UniformOptions options(LEVELS);
  options.fullTopologyInLastLevel = false;
  refiner->RefineUniform(options);
  return refiner;
}

static std::vector<Point> places(const Far::TopologyRefiner &refiner, const Mesh &mesh) {
  std::vector<Point> old(mesh.vertices.shape[0]), finer;
  memcpy(old.data(), mesh.vertices.f.data(), old.size() * sizeof(Point));
  Far::PrimvarRefinerReal<double> primvar(refiner);
  for (int level = 1; level <= LEVELS; level++) {
    finer.resize(refiner.GetLevel(level).GetNumVertices());
    primvar.Interpolate(level, old, finer);
    old.swap(finer);
  }
  return old;
}

static std::vector<int> faces(const Far::TopologyRefiner &refiner, int sides) {
  const Far::TopologyLevel &level = refiner.GetLevel(LEVELS);
  std::vector<int> corners;
  corners.reserve(size_t(level.GetNumFaces()) * sides);
  for (int face = 0; face < level.GetNumFaces(); face++)
    for (int corner : level.GetFaceVertices(face)) corners.push_back(corner);
  return corners;
}

int main(int, char **args) {
  bool loop = *args[1] == '1', only_places = *args[2] == '1';
  Mesh mesh{npy(std::string(args[3]) + "_v"), npy(std::string(args[3]) + "_f")};
  int sides = int(mesh.faces.shape[1]);
  auto kept = refine(mesh, loop);
  double sum = 0;
  for (auto &point : places(*kept, mesh)) sum += point.x[0] * point.x[0];
  printf("%.17g\n", sum), fflush(stdout);
  for (std::string line; std::getline(std::cin, line);) {
    auto start = std::chrono::steady_clock::now();
    std::vector<Point> points;
    std::vector<int> corners;
    std::unique_ptr<Far::TopologyRefiner> refiner;
    if (only_places) {
      points = places(*kept, mesh);
    } else {
      refiner = refine(mesh, loop);
      points = places(*refiner, mesh);
      corners = faces(*refiner, sides);
    }
    std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - start;
    printf("%.4f\n", time.count()), fflush(stdout);
  }
}

// Refines a mesh with OpenSubdiv:  opensubdiv IN OUT
//
// IN: scheme (0 Catmull-Clark, 1 Loop), levels, boundary (0 edge only, 1 edge and corner), creasing (0 uniform, 1 Chaikin); numbers
// of vertices, faces and creases; the positions; for each face its number of corners and its corners; for each crease two vertices and
// a sharpness. OUT: the number of refined vertices as a double, their positions, and their limit positions in double precision.
#include <opensubdiv/far/primvarRefiner.h>
#include <opensubdiv/far/topologyDescriptor.h>
#include <opensubdiv/far/topologyRefinerFactory.h>

#include <fstream>
#include <memory>
#include <vector>
using namespace OpenSubdiv;

struct Point {
  double x[3];
  void Clear(void * = nullptr) { x[0] = x[1] = x[2] = 0; }
  void AddWithWeight(const Point &other, double weight) {
    for (int i = 0; i < 3; i++) x[i] += weight * other.x[i];
  }
};

int main(int, char **args) {
  std::ifstream in(args[1]);
  int scheme, levels, boundary, creasing, vertices, faces, creases;
  in >> scheme >> levels >> boundary >> creasing >> vertices >> faces >> creases;
  std::vector<Point> points(vertices);
  for (auto &point : points) in >> point.x[0] >> point.x[1] >> point.x[2];
  std::vector<int> sides(faces), corners, pairs;
  for (auto &count : sides) {
    in >> count;
    for (int k = 0, corner; k < count; k++) in >> corner, corners.push_back(corner);
  }
  std::vector<float> sharpness;
  for (int k = 0; k < creases; k++) {
    int a, b;
    double s;
    in >> a >> b >> s;
    pairs.push_back(a), pairs.push_back(b), sharpness.push_back(float(s));
  }
  if (!in) return 1;

  Sdc::Options options;
  options.SetVtxBoundaryInterpolation(boundary ? Sdc::Options::VTX_BOUNDARY_EDGE_AND_CORNER : Sdc::Options::VTX_BOUNDARY_EDGE_ONLY);
  options.SetCreasingMethod(creasing ? Sdc::Options::CREASE_CHAIKIN : Sdc::Options::CREASE_UNIFORM);
  Far::TopologyDescriptor mesh;
  mesh.numVertices = vertices, mesh.numFaces = faces;
  mesh.numVertsPerFace = sides.data(), mesh.vertIndicesPerFace = corners.data();
  mesh.numCreases = creases, mesh.creaseVertexIndexPairs = pairs.data(), mesh.creaseWeights = sharpness.data();
  typedef Far::TopologyRefinerFactory<Far::TopologyDescriptor> Factory;
  std::unique_ptr<Far::TopologyRefiner> refiner(
      Factory::Create(mesh, Factory::Options(scheme ? Sdc::SCHEME_LOOP : Sdc::SCHEME_CATMARK, options)));
  if (!refiner) return 2;
  Far::TopologyRefiner::UniformOptions uniform(levels);
  uniform.fullTopologyInLastLevel = true;
  refiner->RefineUniform(uniform);
  Far::PrimvarRefinerReal<double> primvar(*refiner);
  for (int level = 1; level <= levels; level++) {
    std::vector<Point> finer(refiner->GetLevel(level).GetNumVertices());
    primvar.Interpolate(level, points, finer);
    points.swap(finer);
  }
  std::vector<Point> limit(points.size());
  primvar.Limit(points, limit);

  std::ofstream out(args[2], std::ios::binary);
  double count = points.size();
  out.write(reinterpret_cast<char *>(&count), sizeof count);
  out.write(reinterpret_cast<char *>(points.data()), points.size() * sizeof(Point));
  out.write(reinterpret_cast<char *>(limit.data()), limit.size() * sizeof(Point));
  return out ? 0 : 3;
}

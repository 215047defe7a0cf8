// Refines a closed mesh with the Doo-Sabin scheme of CGAL:  cgal IN OUT
//
// IN and OUT have the formats of opensubdiv.cpp, but all options except the levels are ignored, and OUT has no limit positions.
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/subdivision_method_3.h>

#include <fstream>
#include <vector>
typedef CGAL::Simple_cartesian<double> Kernel;
typedef CGAL::Surface_mesh<Kernel::Point_3> Mesh;

int main(int, char **args) {
  std::ifstream in(args[1]);
  int scheme, levels, boundary, creasing, vertices, faces, creases;
  in >> scheme >> levels >> boundary >> creasing >> vertices >> faces >> creases;
  Mesh mesh;
  for (int k = 0; k < vertices; k++) {
    double x, y, z;
    in >> x >> y >> z;
    mesh.add_vertex({x, y, z});
  }
  for (int k = 0, count; k < faces; k++) {
    in >> count;
    std::vector<Mesh::Vertex_index> corners;
    for (int j = 0, corner; j < count; j++) in >> corner, corners.push_back(Mesh::Vertex_index(corner));
    if (mesh.add_face(corners) == Mesh::null_face()) return 2;
  }
  if (!in) return 1;
  CGAL::Subdivision_method_3::DooSabin_subdivision(mesh, CGAL::parameters::number_of_iterations(levels));

  std::ofstream out(args[2], std::ios::binary);
  double count = mesh.number_of_vertices();
  out.write(reinterpret_cast<char *>(&count), sizeof count);
  for (auto vertex : mesh.vertices()) {
    auto point = mesh.point(vertex);
    double x[3] = {point.x(), point.y(), point.z()};
    out.write(reinterpret_cast<char *>(x), sizeof x);
  }
  return out ? 0 : 3;
}

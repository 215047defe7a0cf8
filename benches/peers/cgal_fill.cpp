// Fills the holes of a mesh with CGAL:  cgal_fill CONTINUITY IN OUT SKIP  (SKIP 1: the longest border is not a hole). Prints milliseconds.
// g++ -O3 -march=native -DNDEBUG -DCGAL_EIGEN3_ENABLED -std=c++17 -frounding-math -I/usr/include/eigen3 benches/peers/cgal_fill.cpp -o cgal_fill -lgmp -lmpfr
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/border.h>
#include <CGAL/Polygon_mesh_processing/triangulate_hole.h>
#include <CGAL/Surface_mesh.h>
#include <chrono>
#include <fstream>
#include <iostream>

typedef CGAL::Exact_predicates_inexact_constructions_kernel K;
typedef CGAL::Surface_mesh<K::Point_3> Mesh;
namespace PMP = CGAL::Polygon_mesh_processing;

int main(int, char** argv) {
  std::ifstream in(argv[2]);
  size_t n, m;
  in >> n >> m;
  Mesh base;
  for (size_t i = 0; i < n; i++) {
    double x, y, z;
    in >> x >> y >> z;
    base.add_vertex(K::Point_3(x, y, z));
  }
  for (size_t i = 0; i < m; i++) {
    unsigned a, b, c;
    in >> a >> b >> c;
    base.add_face(Mesh::Vertex_index(a), Mesh::Vertex_index(b), Mesh::Vertex_index(c));
  }
  unsigned continuity = std::stoi(argv[1]);
  bool skip = std::stoi(argv[4]);
  double best = 1e99;
  Mesh mesh;
  for (int run = 0; run < 3; run++) {
    mesh = base;
    auto start = std::chrono::steady_clock::now();
    mesh = base;
    std::vector<Mesh::Halfedge_index> borders;
    PMP::extract_boundary_cycles(mesh, std::back_inserter(borders));
    size_t longest = 0;
    Mesh::Halfedge_index outer;
    if (skip)
      for (auto h : borders) {
        size_t length = 0;
        for (auto g : CGAL::halfedges_around_face(h, mesh)) (void)g, length++;
        if (length > longest) longest = length, outer = h;
      }
    for (auto h : borders) {
      if (skip && h == outer) continue;
      std::vector<Mesh::Face_index> faces;
      std::vector<Mesh::Vertex_index> vertices;
      PMP::triangulate_refine_and_fair_hole(mesh, h, std::back_inserter(faces), std::back_inserter(vertices),
                                            CGAL::parameters::fairing_continuity(continuity));
    }
    best = std::min(best, std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count());
  }
  std::ofstream out(argv[3]);
  out.precision(17);
  for (auto v : mesh.vertices()) out << "v " << mesh.point(v) << "\n";
  for (auto f : mesh.faces()) {
    out << "f";
    for (auto v : CGAL::vertices_around_face(mesh.halfedge(f), mesh)) out << " " << (unsigned)v + 1;
    out << "\n";
  }
  std::cout << best << std::endl;
}

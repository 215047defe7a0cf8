//! Edges that lie exactly in a face or along an edge of another surface, and whether the surfaces cross there.
//!
//! Two surfaces cross along curves. If a curve does not pass through the interiors of faces, it runs along an edge of one surface. Around
//! such an edge, each surface consists of two half-planes. Their order around the edge decides: if the half-planes of the surfaces
//! alternate, the surfaces cross; this is the local test of Hachenberger, Kettner and Mehlhorn, "Boolean operations on 3D selective Nef
//! complexes" (2007), for an edge. If half-planes coincide, the surfaces share a plane region. Then the two surfaces cross if one leaves
//! the other to different sides around the whole region.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};
use robust::{Coord, orient2d};

use super::{Corners, Predicates, edges_of, straddles};

/// An edge of one triangle in the plane of another one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contact {
    pub(super) edge: [u32; 2],
    /// The index of the triangle to which the edge belongs.
    pub(super) of: u32,
    /// The index of the other triangle.
    pub(super) other: u32,
}

/// The triangles at some edges, sorted by edge.
pub(super) struct EdgeWings(Vec<([u32; 2], u32)>);

impl EdgeWings {
    /// Collects the triangles at all edges of the triangles in `contacts`.
    pub(super) fn new(triangles: &[(u32, Corners)], contacts: &[Contact]) -> Self {
        let mut edges: Vec<[u32; 2]> = contacts
            .iter()
            .flat_map(|it| [it.of, it.other])
            .flat_map(|it| edges_of(triangles[it as usize].1))
            .map(sorted)
            .collect();
        edges.sort_unstable();
        edges.dedup();
        let mut wings = Vec::new();
        for (number, (_, corners)) in (0..).zip(triangles) {
            let own = edges_of(*corners).map(sorted);
            wings.extend(
                own.iter().filter(|it| edges.binary_search(it).is_ok()).map(|it| (*it, number)),
            );
        }
        wings.sort_unstable();
        Self(wings)
    }

    /// The two triangles at an edge; `None` at a border, and where more than two triangles meet.
    fn of(&self, edge: [u32; 2]) -> Option<[u32; 2]> {
        let edge = sorted(edge);
        let first = self.0.partition_point(|it| it.0 < edge);
        let found: Vec<u32> =
            self.0[first..].iter().take_while(|it| it.0 == edge).map(|it| it.1).take(3).collect();
        <[u32; 2]>::try_from(found).ok()
    }
}

fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Returns true if an edge in the plane of a triangle has more than a point in common with the triangle's interior or with one of its
/// edges.
pub(super) fn overlaps(predicates: &Predicates<'_>, edge: [u32; 2], triangle: Corners) -> bool {
    Plane::of(predicates, triangle).is_some_and(|plane| {
        plane.crosses_interior(predicates, edge, triangle)
            || edges_of(triangle).into_iter().any(|other| plane.runs_along(predicates, edge, other))
    })
}

/// Returns true if the line through an edge separates the projections of two triangles, which then have at most corners in common.
pub(super) fn are_apart(predicates: &Predicates<'_>, a: Corners, b: Corners) -> bool {
    [(a, b), (b, a)].into_iter().any(|(own, other)| {
        let Some(plane) = Plane::of(predicates, own) else { return false };
        // The edges at a common corner come first: one of them separates most neighbors.
        let common = own.iter().position(|corner| other.contains(corner)).unwrap_or(0);
        let [p, q, r] = [0, 1, 2].map(|k| own[(common + k) % 3]);
        [[p, q], [r, p], [q, r]].into_iter().any(|[p, q]| {
            other.iter().filter(|corner| !own.contains(corner)).all(|&corner| {
                let side = plane.side(predicates, [p, q, corner]);
                if plane.is_counter_clockwise { side < 0.0 } else { 0.0 < side }
            })
        })
    })
}

/// A plane onto which points are projected along a coordinate axis.
#[derive(Clone, Copy)]
struct Plane {
    axes: [usize; 2],
    /// True if the triangle that defines the plane is counter-clockwise in the projection.
    is_counter_clockwise: bool,
}

impl Plane {
    /// The plane of a triangle; `None` if the triangle has no area.
    fn of(predicates: &Predicates<'_>, triangle: Corners) -> Option<Self> {
        let [a, b, c] = triangle.map(|vertex| predicates.mesh.positions()[vertex as usize]);
        let normal: Vector3<f64> = (b - a).cross(&(c - a));
        let axis = normal.iamax();
        // If rounding hides which projection has an area, try all.
        [axis, (axis + 1) % 3, (axis + 2) % 3].into_iter().find_map(|axis| {
            let axes = [(axis + 1) % 3, (axis + 2) % 3];
            let plane = Self { axes, is_counter_clockwise: true };
            let side = plane.side(predicates, triangle);
            (side != 0.0).then_some(Self { is_counter_clockwise: 0.0 < side, ..plane })
        })
    }

    fn coord(self, predicates: &Predicates<'_>, vertex: u32) -> Coord<f64> {
        let Point3 { coords } = predicates.mesh.positions()[vertex as usize];
        Coord { x: coords[self.axes[0]], y: coords[self.axes[1]] }
    }

    /// The orientation of three vertices in this plane, as the sign of their area. It is 0 if the third is on the line through the others.
    fn side(self, predicates: &Predicates<'_>, [a, b, c]: Corners) -> f64 {
        if a == b || b == c || c == a {
            return 0.0;
        }
        let [a, b, c] = [a, b, c].map(|vertex| self.coord(predicates, vertex));
        let area = orient2d(a, b, c);
        let length = (b.x - a.x).abs() + (b.y - a.y).abs();
        if area.abs() <= predicates.tolerance * length { 0.0 } else { area }
    }

    /// Returns true if an edge has more than a point in common with the interior of a triangle in the same plane: no line along a side of
    /// either separates them.
    fn crosses_interior(
        self,
        predicates: &Predicates<'_>,
        edge: [u32; 2],
        triangle: Corners,
    ) -> bool {
        let sign = self.side(predicates, triangle);
        let sides = triangle.map(|vertex| self.side(predicates, [edge[0], edge[1], vertex]));
        straddles(sides)
            && !edges_of(triangle).into_iter().any(|[u, v]: [u32; 2]| {
                edge.iter().all(|&end| {
                    let side = self.side(predicates, [u, v, end]);
                    if sign < 0.0 { 0.0 <= side } else { side <= 0.0 }
                })
            })
    }

    /// Returns true if two edges in this plane are on one line and have more than a point in common.
    fn runs_along(self, predicates: &Predicates<'_>, edge: [u32; 2], other: [u32; 2]) -> bool {
        if sorted(edge) == sorted(other)
            || other.iter().any(|&end| self.side(predicates, [edge[0], edge[1], end]) != 0.0)
        {
            return false;
        }
        let [a, b] = edge.map(|vertex| predicates.mesh.positions()[vertex as usize]);
        let axis = (b - a).iamax();
        let [mut own, mut its] =
            [edge, other].map(|ends| ends.map(|it| predicates.mesh.positions()[it as usize][axis]));
        own.sort_by(f64::total_cmp);
        its.sort_by(f64::total_cmp);
        own[0].max(its[0]) + predicates.tolerance < own[1].min(its[1])
    }
}

/// A half-plane of a surface at an edge: a triangle, and a vertex of it beside the line through the edge.
#[derive(Clone, Copy, Debug)]
struct HalfPlane {
    triangle: u32,
    toward: u32,
}

/// The angle from one half-plane to another one, counter-clockwise around the directed edge.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Angle {
    Zero,
    LessThanHalf,
    Half,
    MoreThanHalf,
}

/// The pairs of faces at which surfaces cross along edges, as numbers of faces in ascending order.
pub(super) fn crossing_contacts(
    predicates: &Predicates<'_>,
    triangles: &[(u32, Corners)],
    wings: &EdgeWings,
    contacts: &[Contact],
) -> Vec<[u32; 2]> {
    let mut pairs = Vec::new();
    let mut regions = Regions::default();
    for contact in contacts {
        let other = triangles[contact.other as usize].1;
        let (Some(own), Some(plane)) = (wings.of(contact.edge), Plane::of(predicates, other))
        else {
            continue;
        };
        let line = Line { predicates, triangles, ends: contact.edge };
        let own = own.map(|triangle| HalfPlane { triangle, toward: line.apex(triangle) });
        // A triangle that borders the edge itself is part of the same surface.
        if own.iter().any(|it| it.triangle == contact.other) {
            continue;
        }
        let mut others = Vec::new();
        if plane.crosses_interior(predicates, contact.edge, other) {
            let ends = contact.edge;
            let sides = other.map(|vertex| plane.side(predicates, [ends[0], ends[1], vertex]));
            fn beside(
                is_left: bool,
                other: [u32; 3],
                sides: [f64; 3],
                contact_other: u32,
            ) -> Option<HalfPlane> {
                let mut corners = other.into_iter().zip(sides);
                let found = corners.find(|it| if is_left { 0.0 < it.1 } else { it.1 < 0.0 });
                found.map(|it| HalfPlane { triangle: contact_other, toward: it.0 })
            }
            others.extend(
                beside(true, other, sides, contact.other)
                    .zip(beside(false, other, sides, contact.other))
                    .map(|(left, right)| [left, right]),
            );
        }
        for edge in edges_of(other) {
            if plane.runs_along(predicates, contact.edge, edge)
                && let Some(beside) = wings.of(edge)
            {
                let along = Line { ends: edge, ..line };
                others.push(
                    beside.map(|triangle| HalfPlane { triangle, toward: along.apex(triangle) }),
                );
            }
        }
        for other in others {
            match line.passage(own, other) {
                Some(Passage::Crosses) => {
                    pairs.push([
                        triangles[contact.of as usize].0,
                        triangles[contact.other as usize].0,
                    ]);
                }
                Some(Passage::Leaves(of, is_above)) => regions.leave(of, is_above),
                Some(Passage::Continues(from, to)) => regions.join(from, to),
                None => {}
            }
            // The same seen from the other surface.
            match line.passage(other, own) {
                Some(Passage::Leaves(of, is_above)) => regions.leave(of, is_above),
                Some(Passage::Continues(from, to)) => regions.join(from, to),
                Some(Passage::Crosses) | None => {}
            }
        }
    }
    let crossed = regions.crossed().into_iter();
    pairs.extend(crossed.map(|of| of.map(|triangle| triangles[triangle as usize].0)));
    pairs.retain(|[a, b]| a != b);
    pairs.iter_mut().for_each(|pair| *pair = sorted(*pair));
    pairs
}

/// What a surface does along an edge at which it touches another surface.
enum Passage {
    /// It passes through the other surface.
    Crosses,
    /// One of its triangles coincides with one of the other surface; beyond the edge it is above the other surface, or below.
    Leaves([u32; 2], bool),
    /// It coincides with the other surface on both sides of the edge.
    Continues([u32; 2], [u32; 2]),
}

/// The line through an edge.
#[derive(Clone, Copy)]
struct Line<'a> {
    predicates: &'a Predicates<'a>,
    triangles: &'a [(u32, Corners)],
    ends: [u32; 2],
}

impl Line<'_> {
    /// The corner of a triangle opposite to its edge on this line.
    fn apex(&self, triangle: u32) -> u32 {
        let corners = self.triangles[triangle as usize].1;
        corners.into_iter().find(|it| !self.ends.contains(it)).unwrap_or(corners[0])
    }

    /// Compares two surfaces, each given by its two half-planes at the line. `None` if the first touches the second only here, or if one of
    /// the surfaces is folded.
    fn passage(&self, own: [HalfPlane; 2], other: [HalfPlane; 2]) -> Option<Passage> {
        let angle = |a: HalfPlane, b: HalfPlane| self.angle(a.toward, b.toward);
        if angle(own[0], own[1])? == Angle::Zero || angle(other[0], other[1])? == Angle::Zero {
            return None;
        }
        for [a, b] in [[0, 1], [1, 0]] {
            for [c, d] in [[0, 1], [1, 0]] {
                if angle(own[a], other[c])? != Angle::Zero {
                    continue;
                }
                let shared = [own[a].triangle, other[c].triangle];
                if angle(own[b], other[d])? == Angle::Zero {
                    return Some(Passage::Continues(shared, [own[b].triangle, other[d].triangle]));
                }
                let is_after = self.is_between(own[b], [other[c], other[d]])?;
                return Some(Passage::Leaves(shared, is_after == self.faces_ahead(other[c])?));
            }
        }
        let [first, second] = own.map(|it| self.is_between(it, other));
        (first? != second?).then_some(Passage::Crosses)
    }

    /// Returns true if a half-plane is in the sector that begins at the first of two other half-planes and ends at the second, in
    /// counter-clockwise order.
    fn is_between(&self, own: HalfPlane, [from, to]: [HalfPlane; 2]) -> Option<bool> {
        let angle = |a: HalfPlane, b: HalfPlane| self.angle(a.toward, b.toward);
        let is_in_less_than_half = |from, to| -> Option<bool> {
            Some(angle(from, own)? == Angle::LessThanHalf && angle(own, to)? == Angle::LessThanHalf)
        };
        match angle(from, to)? {
            Angle::Zero => None,
            Angle::LessThanHalf => is_in_less_than_half(from, to),
            Angle::Half => Some(angle(from, own)? == Angle::LessThanHalf),
            Angle::MoreThanHalf => Some(!is_in_less_than_half(to, from)?),
        }
    }

    /// Returns true if the normal of a half-plane's triangle points in the counter-clockwise direction.
    fn faces_ahead(&self, half: HalfPlane) -> Option<bool> {
        let corners = self.triangles[half.triangle as usize].1;
        let plane = Plane::of(self.predicates, corners)?;
        let own = plane.side(self.predicates, corners);
        let along = plane.side(self.predicates, [self.ends[0], self.ends[1], half.toward]);
        (along != 0.0).then_some((0.0 < own) == (0.0 < along))
    }

    /// The angle between the half-planes from this line toward two vertices; `None` if a vertex is on the line.
    fn angle(&self, from: u32, to: u32) -> Option<Angle> {
        let [a, b] = self.ends;
        let plane = Plane::of(self.predicates, [a, b, from])?;
        let beside = plane.side(self.predicates, [a, b, from]);
        let turn = if from == to || self.ends.contains(&to) {
            0.0
        } else {
            self.predicates.side([a, b, from], to)
        };
        if turn != 0.0 {
            // The determinant is negative if the second vertex is above the triangle.
            return Some(if turn < 0.0 { Angle::LessThanHalf } else { Angle::MoreThanHalf });
        }
        let other = plane.side(self.predicates, [a, b, to]);
        match other != 0.0 {
            true => Some(if (0.0 < other) == (0.0 < beside) { Angle::Zero } else { Angle::Half }),
            false => None,
        }
    }
}

/// Regions in which two surfaces coincide. Each region consists of pairs of coinciding triangles: one of the surface that is judged, and
/// one of the other surface.
#[derive(Default)]
struct Regions {
    numbers: BTreeMap<[u32; 2], usize>,
    /// For each pair, another pair of the same region, or itself.
    parents: Vec<usize>,
    /// The pairs at which the judged surface leaves the other one, and whether it is above the other one beyond.
    exits: Vec<([u32; 2], bool)>,
}

impl Regions {
    fn number(&mut self, pair: [u32; 2]) -> usize {
        let next = self.parents.len();
        let number = *self.numbers.entry(pair).or_insert(next);
        if number == next {
            self.parents.push(next);
        }
        number
    }

    fn root(&self, mut number: usize) -> usize {
        while self.parents[number] != number {
            number = self.parents[number];
        }
        number
    }

    fn join(&mut self, a: [u32; 2], b: [u32; 2]) {
        let [a, b] = [a, b].map(|pair| self.number(pair));
        let [a, b] = [self.root(a), self.root(b)];
        self.parents[a.max(b)] = a.min(b);
    }

    fn leave(&mut self, pair: [u32; 2], is_above: bool) {
        self.number(pair);
        self.exits.push((pair, is_above));
    }

    /// The pairs of triangles at the rims of regions that a surface enters from one side and leaves to the other.
    fn crossed(&self) -> Vec<[u32; 2]> {
        let mut sides = vec![[false; 2]; self.parents.len()];
        for (pair, is_above) in &self.exits {
            sides[self.root(self.numbers[pair])][usize::from(*is_above)] = true;
        }
        let pairs = self.exits.iter().map(|it| it.0);
        pairs.filter(|pair| sides[self.root(self.numbers[pair])] == [true; 2]).collect()
    }
}

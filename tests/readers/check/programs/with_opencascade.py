"""Open CASCADE, which FreeCAD and many other CAD programs use."""

import pathlib

import record
from OCP.BRep import BRep_Tool
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.GeomConvert import GeomConvert
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.STEPControl import STEPControl_Reader
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS


def read(path: pathlib.Path) -> record.Record:
    reader = STEPControl_Reader()
    if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise ValueError("cannot read the file")
    reader.TransferRoots()
    shape = reader.OneShape()
    if not BRepCheck_Analyzer(shape).IsValid():
        raise ValueError("invalid shape")
    explorer = TopExp_Explorer(shape, TopAbs_ShapeEnum.TopAbs_FACE)
    faces = []
    while explorer.More():
        faces.append(explorer.Current())
        explorer.Next()
    if len(faces) != 1:
        raise ValueError(f"{len(faces)} faces")
    surface = GeomConvert.SurfaceToBSplineSurface_s(BRep_Tool.Surface_s(as_face(faces[0])))
    surface.SetUNotPeriodic()
    surface.SetVNotPeriodic()
    grid = [(row, column) for row in range(1, surface.NbUPoles() + 1) for column in range(1, surface.NbVPoles() + 1)]
    poles = [surface.Pole(*place) for place in grid]
    return {
        # In mm, whatever the file has.
        "points": [[pole.X(), pole.Y(), pole.Z()] for pole in poles],
        "weights": [surface.Weight(*place) for place in grid],
        "knots": [
            [surface.UKnot(k) for k in range(1, surface.NbUKnots() + 1) for _ in range(surface.UMultiplicity(k))],
            [surface.VKnot(k) for k in range(1, surface.NbVKnots() + 1) for _ in range(surface.VMultiplicity(k))],
        ],
    }


def as_face(shape: object) -> object:
    return (getattr(TopoDS, "Face_s", None) or TopoDS.Face)(shape)


record.main(read)

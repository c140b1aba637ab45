"""Parts, fixtures and the features that must be seen, all in the part frame, mm."""

from mvp.scene.cad_edges import CadEdges, cad_edges
from mvp.scene.catalogue import Entry, FeatureCatalogue, extract_features
from mvp.scene.edge_feature import EdgeFeature, edge_feature
from mvp.scene.face_feature import FaceFeature, face_feature, face_feature_at
from mvp.scene.features import Feature, Kind
from mvp.scene.hole_feature import HoleFeature
from mvp.scene.hole_place import HoleByPlace, hole_feature_at
from mvp.scene.holes import find_holes
from mvp.scene.paper_object import PaperObject, paper_object, without_slit
from mvp.scene.point_feature import PointFeature, point_feature
from mvp.scene.scene import Scene

__all__ = [
    "CadEdges",
    "EdgeFeature",
    "Entry",
    "FaceFeature",
    "Feature",
    "FeatureCatalogue",
    "HoleByPlace",
    "HoleFeature",
    "Kind",
    "PaperObject",
    "PointFeature",
    "Scene",
    "cad_edges",
    "edge_feature",
    "extract_features",
    "face_feature",
    "face_feature_at",
    "find_holes",
    "hole_feature_at",
    "paper_object",
    "point_feature",
    "without_slit",
]

"""Pictures for people: solids, regions and viewpoints."""

from mvp.cell.figures.scene_picture import SceneParts, Viewpoint, scene_picture

__all__ = ["SceneParts", "Viewpoint", "scene_picture"]

"""Pictures for people: solids, regions, viewpoints and expected views."""

from mvp.cell.figures.plan_pictures import write_plan_pictures
from mvp.cell.figures.scene_picture import SceneParts, Viewpoint, scene_picture

__all__ = ["SceneParts", "Viewpoint", "scene_picture", "write_plan_pictures"]

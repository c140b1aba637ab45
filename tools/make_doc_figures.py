"""Draw the pictures of the documentation: regions of the paper's object and the slit.

python tools/make_doc_figures.py docs/images
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from mvp.cell.figures import SceneParts, Viewpoint, scene_picture
from mvp.geometry import Box
from mvp.scene import edge_feature, paper_object
from mvp.visibility import intersection, prepare, visibility_region

WORKSPACE = Box(np.full(3, -600.0), np.full(3, 600.0))
FEATURES = {
    "horizontal edge": ([-12.7, 0.0, 12.7], [12.7, 0.0, 12.7]),
    "vertical edge": ([12.7, 0.0, -12.7], [12.7, 0.0, 12.7]),
}
PUBLISHED = {
    "V_f": ([107.58, -231.43, 258.68], [-0.389, 0.694, -0.608]),
    "V_f1": ([197.10, 100.58, 330.45], [-0.513, -0.255, -0.820]),
    "V_f2": ([112.78, 110.49, 159.77], [-0.444, -0.583, -0.680]),
}
FRAME = Box(np.array([-190.0, -330.0, -30.0]), np.array([330.0, 260.0, 400.0]))
SLIT = Box(np.array([-30.0, -50.0, 45.0]), np.array([190.0, 110.0, 130.0]))


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    part = paper_object()
    occluders = prepare(part)
    features = {
        name: edge_feature(name, np.array(a), np.array(b), part)
        for name, (a, b) in FEATURES.items()
    }
    regions = {
        name: visibility_region(occluders, feature.sight_pieces(), WORKSPACE)
        for name, feature in features.items()
    }
    views = [
        Viewpoint(name, np.array(r), np.array(n) / np.linalg.norm(n))
        for name, (r, n) in PUBLISHED.items()
    ]
    outlines = [line for f in features.values() for line in f.outline_mm]
    for name, region in regions.items():
        scene_picture(
            SceneParts(part, (), region.mesh, list(features[name].outline_mm)),
            folder / f"region_{name.replace(' ', '_')}.png",
            title=f"Visibility region of the {name}",
            frame=FRAME,
            forward=(-0.75, 0.55, -0.5),
        )
    both = intersection(list(regions.values()))
    scene_picture(
        SceneParts(part, (), both.mesh, outlines, views),
        folder / "region_both_edges.png",
        title="Where both edges are seen, with the published viewpoints",
        frame=FRAME,
        forward=(-0.75, 0.55, -0.5),
    )
    scene_picture(
        SceneParts(
            part,
            (),
            regions["vertical edge"].mesh,
            list(features["vertical edge"].outline_mm),
        ),
        folder / "slit.png",
        title="Region of the vertical edge above the slit of the large hole",
        frame=SLIT,
        forward=(-0.5, 0.55, -0.67),
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs/images"))

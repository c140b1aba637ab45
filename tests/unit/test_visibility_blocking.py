"""Which face hides a feature, and which one would next."""

import numpy as np
import pytest

from mvp.geometry import (
    Box,
    FeaturePiece,
    Pose,
    TriangleMesh,
    box_mesh,
)
from mvp.scene import Scene, extract_features, paper_object
from mvp.visibility import (
    NOTHING,
    OWN_FACES,
    blocking_faces,
    exactly_visible,
    intersection,
    limiting_faces,
    prepare,
    visibility_region,
)

WORKSPACE = Box([-200.0] * 3, [200.0] * 3)
PART = box_mesh(Box([-20.0, -20.0, -20.0], [20.0, 20.0, 0.0]), name="bracket")
POST = box_mesh(Box([80.0, -80.0, -80.0], [90.0, -70.0, 200.0]), name="post")
CLAMP = box_mesh(Box([-50.0, -50.0, -20.0], [50.0, -40.0, 30.0]), name="clamp")
SCENE = Scene(PART, (POST, CLAMP), ())
# The top front edge; in front of it stands the clamp, aside of it the post.
EDGE = FeaturePiece(
    [[-20, -20, 0], [20, -20, 0]], [[0, -1, 0, 20], [0, 0, 1, 0]], "any"
)


def named(faces):
    return [SCENE.face_name(face) for face in faces]


def face_towards(mesh, normal):
    """Catalogue id of the face of a mesh that looks along a direction."""
    faces = [e for e in extract_features(mesh).entries if e.kind == "face"]
    return next(e.id for e in faces if e.direction @ normal > 0.99)


def test_a_face_is_named_as_the_catalogue_of_its_body_lists_it():
    names = [SCENE.face_name(face) for face in range(18)]
    assert set(names[:6]) == {f"face F{n} of part" for n in range(1, 7)}
    assert set(names[6:12]) == {f"face F{n} of fixture post" for n in range(1, 7)}
    assert names[12].endswith("of fixture clamp")
    for face, name in enumerate(names[:6]):
        listed = extract_features(PART).feature(name.split()[1])
        members = np.flatnonzero(PART.face_ids == face)
        assert PART.normals[members[0]] @ listed.normal > 0.99
    for nobody in (-1, 18):
        with pytest.raises(KeyError):
            SCENE.face_name(nobody)


def test_a_fixture_that_stands_turned_keeps_the_names_of_its_file():
    turned = Pose.from_rotvec("part", "base", [0, 0, 1.5], [5, 0, 0])
    scene = Scene(PART, (CLAMP.moved(turned),), (), (CLAMP,))
    alone = Scene(CLAMP, (), ())
    for face in range(6):
        name = alone.face_name(face).replace("part", "fixture clamp")
        assert scene.face_name(6 + face) == name


def test_a_face_that_no_list_names_is_told_by_a_point_on_it():
    turn = np.linspace(0, 2 * np.pi, 33)[:-1]
    ring = np.column_stack([10 * np.cos(turn), 10 * np.sin(turn)])
    low = np.column_stack([ring, np.zeros(32)])
    high = np.column_stack([ring, np.full(32, 30.0)])
    i, j = np.arange(32), (np.arange(32) + 1) % 32
    side = np.concatenate(
        [np.column_stack([i, j, j + 32]), np.column_stack([i, j + 32, i + 32])]
    )
    cap = np.column_stack([np.zeros(30, int), i[1:31], i[2:32]])
    faces = np.concatenate([side, cap[:, ::-1], cap + 32])
    ids = np.repeat([0, 1, 2], [64, 30, 30])
    scene = Scene(TriangleMesh(np.concatenate([low, high]), faces, ids), (), ())
    name = scene.face_name(0)
    assert name.startswith("a curved face near (")
    assert name.endswith(") mm of part")
    place = [float(v) for v in name[name.index("(") + 1 : name.index(")")].split(",")]
    assert np.hypot(place[0], place[1]) == pytest.approx(10, abs=0.3)
    assert 0 < place[2] < 30
    assert {scene.face_name(1), scene.face_name(2)} == {
        "face F1 of part",
        "face F2 of part",
    }


def test_the_face_before_a_feature_is_the_one_that_blocks_it():
    occluders = prepare(SCENE.occluders)
    points = [[0, -150, 10], [0, -25, 100], [0, 150, -10], [170, -130, 250]]
    faces = blocking_faces(occluders, [EDGE], points)
    assert faces[1:3].tolist() == [NOTHING, OWN_FACES]
    towards_the_edge = face_towards(CLAMP, [0, 1, 0])
    assert named(faces[[0]]) == [f"face {towards_the_edge} of fixture clamp"]
    assert named(faces[[3]])[0].endswith("of fixture post")


def test_something_blocks_wherever_the_exact_test_sees_nothing():
    mesh = paper_object()
    piece = extract_features(mesh).feature("E1").sight_pieces()
    points = np.random.default_rng(3).uniform(-300, 300, (200, 3))
    found = blocking_faces(prepare(mesh), piece, points)
    seen = exactly_visible(mesh, piece, points)
    assert 0 < seen.sum() < 200
    assert ((found == NOTHING) == seen).all()


def test_the_limiting_face_is_the_one_whose_shadow_is_near():
    region = visibility_region(prepare(SCENE.occluders), [EDGE], WORKSPACE)
    # Just over the plane through the edge and the clamp's upper rear edge.
    over_the_clamp = [0, -20 - 2 * 20, 2 * 30 + 5]
    assert region.contains([over_the_clamp]).all()
    faces = limiting_faces(region, [over_the_clamp, [0, 100, 4], [0, 100, -4]])
    assert faces[1:].tolist() == [OWN_FACES, OWN_FACES]
    assert named(faces[:1])[0].endswith("of fixture clamp")


def test_without_a_boundary_nothing_limits_a_view():
    point = FeaturePiece([[0, 0, 0]])
    far = box_mesh(Box([900.0] * 3, [910.0] * 3), name="far")
    region = visibility_region(prepare(far), [point], WORKSPACE)
    assert limiting_faces(region, [[10, 20, 30]]).tolist() == [NOTHING]


def test_an_empty_region_says_by_name_what_blocks():
    cover = box_mesh(Box([-30.0, -30.0, 1.0], [30.0, 30.0, 9.0]), name="clamp")
    skirt = box_mesh(Box([-30.0, -30.0, -20.0], [30.0, -21.0, 1.0]), name="apron")
    scene = Scene(PART, (cover, skirt), ())
    closed = Box([-300.0, -300.0, 30.0], [300.0, 300.0, 300.0])
    region = visibility_region(prepare(scene.occluders), [EDGE], closed)
    assert region.empty
    words = region.in_the_way(scene.face_name)
    lower = face_towards(cover, [0, 0, -1])
    assert words.startswith(f"blocked by face {lower} of fixture clamp (")
    faces = limiting_faces(region, [[0, 0, 100]])
    assert scene.face_name(faces[0]) == f"face {lower} of fixture clamp"


def test_of_several_features_each_can_be_the_limit():
    occluders = prepare(SCENE.occluders)
    rear = FeaturePiece(
        [[-20, 20, 0], [20, 20, 0]], [[0, 1, 0, 20], [0, 0, 1, 0]], "any"
    )
    both = intersection(
        [visibility_region(occluders, [piece], WORKSPACE) for piece in (EDGE, rear)]
    )
    faces = limiting_faces(both, [[0, -150, 150], [0, 150, 2]])
    assert named(faces[:1])[0].endswith("of fixture clamp")
    assert faces[1] == OWN_FACES

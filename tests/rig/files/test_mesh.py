"""Meshes from OBJ, PLY and glTF files: the same room from each, and what is refused with the file's name."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from rig.errors import UsageError
from rig.files.mesh import UpAxis, read_mesh, read_triangles
from sim.scenes.gridded import paper_room, room_with_box

OBJ = """mtllib room.mtl
v 0 0 0
v 2 0 0
v 2 3 0
v 0 3 0
v 0 0 1
v 2 0 1
v 2 3 1
v 0 3 1
usemtl white
f 1 2 3 4
f 5 8 7 6
usemtl grey
f 1 5 6 2
f 2 6 7 3
f 3 7 8 4
f 4 8 5 1
"""
MTL = "newmtl white\nKd 0.8 0.8 0.8\nnewmtl grey\nKd 0.5 0.4 0.3\n"
GREY = 0.2126 * 0.5 + 0.7152 * 0.4 + 0.0722 * 0.3


@pytest.fixture
def room(tmp_path: Path) -> Path:
    (tmp_path / "room.obj").write_text(OBJ, encoding="utf-8")
    (tmp_path / "room.mtl").write_text(MTL, encoding="utf-8")
    return tmp_path / "room.obj"


@pytest.fixture
def glb(room: Path) -> Path:
    """The same file with z as its axis upwards, as no glTF should have it."""
    trimesh.load_scene(room, process=False).export(room.with_suffix(".glb"))
    return room.with_suffix(".glb")


def ply(folder: Path, header: str, corners: str) -> Path:
    path = folder / "square.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        f"{header}end_header\n{corners}",
        encoding="ascii",
    )
    return path


def test_an_obj_room_is_six_closed_convex_quads_with_their_materials(room: Path) -> None:
    mesh = read_mesh(room)
    assert mesh.name == "room"
    assert mesh.n_patches == 6
    assert mesh.closed
    assert mesh.convex
    assert mesh.areas.sum() == pytest.approx(22)
    floor_and_ceiling = np.abs(mesh.normals[:, 2]) > 0.5
    assert mesh.reflectance[floor_and_ceiling] == pytest.approx(0.8, abs=1e-15)
    assert mesh.reflectance[~floor_and_ceiling] == pytest.approx(GREY, abs=1e-15)


def test_a_glb_room_is_the_same_within_its_eight_bits_of_colour(glb: Path) -> None:
    mesh = read_mesh(glb, up="z")
    assert mesh.n_patches == 6
    assert mesh.closed
    assert np.ptp(mesh.vertices.reshape(-1, 3), axis=0) == pytest.approx([2, 3, 1])
    assert np.sort(mesh.reflectance) == pytest.approx([GREY] * 4 + [0.8] * 2, abs=0.5 / 255)


def test_gltf_has_y_upwards_and_rooms_have_z(glb: Path) -> None:
    mesh = read_mesh(glb)
    assert np.ptp(mesh.vertices.reshape(-1, 3), axis=0) == pytest.approx([2, 1, 3])
    assert mesh.closed


def test_places_of_a_gltf_scene_graph_are_applied(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    square = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], process=False)
    mirrored = np.diag([1.0, 1, -1, 1])
    mirrored[:3, 3] = (5, 6, 7)
    scene.add_geometry(square, geom_name="square", node_name="here")
    scene.add_geometry(square, geom_name="square", node_name="there", transform=mirrored)
    scene.export(tmp_path / "two.glb")
    mesh = read_mesh(tmp_path / "two.glb", reflectance=0.5, up="z", colours=False)
    assert np.allclose(np.sort(mesh.centres, axis=0), [[0.5, 0.5, 0], [5.5, 6.5, 7]])
    assert np.allclose(np.sort(mesh.normals[:, 2]), [-1, 1])


def test_corner_colours_of_a_ply_are_srgb(tmp_path: Path) -> None:
    path = ply(
        tmp_path,
        "property uchar red\nproperty uchar green\nproperty uchar blue\n"
        "element face 1\nproperty list uchar int vertex_indices\n",
        "0 0 0 188 188 188\n1 0 0 188 188 188\n1 1 0 188 188 188\n0 1 0 188 188 188\n4 0 1 2 3\n",
    )
    mesh = read_mesh(path)
    assert mesh.n_patches == 1
    assert mesh.reflectance[0] == pytest.approx(0.5, abs=0.003)


def test_a_file_without_colours_needs_a_reflectance(tmp_path: Path) -> None:
    path = ply(
        tmp_path,
        "element face 1\nproperty list uchar int vertex_indices\n",
        "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n",
    )
    assert read_mesh(path, reflectance=0.3).reflectance.tolist() == [0.3]
    with pytest.raises(UsageError, match=r"square\.ply: 2 of 2 triangles have no colour .*reflectance="):
        read_mesh(path)


def test_the_argument_holds_for_all_when_colours_are_ignored(room: Path) -> None:
    assert read_mesh(room, reflectance=0.6, colours=False).reflectance.tolist() == [0.6] * 6


def test_quads_need_not_be_joined(room: Path) -> None:
    mesh = read_mesh(room, join_quads=False)
    assert mesh.n_patches == 12
    assert mesh.closed


@pytest.mark.parametrize(("unit", "scale"), [("m", 1), ("cm", 100), ("mm", 1000)])
def test_units_are_turned_into_metres(room: Path, unit, scale: int) -> None:
    lines = [
        " ".join(["v", *(str(scale * float(x)) for x in line.split()[1:])]) if line.startswith("v ") else line
        for line in OBJ.splitlines()
    ]
    room.write_text("\n".join(lines), encoding="utf-8")
    assert read_mesh(room, unit=unit).areas.sum() == pytest.approx(22)


def edited(room: Path, old: str, new: str) -> Path:
    assert old in OBJ
    room.write_text(OBJ.replace(old, new), encoding="utf-8")
    return room


def test_millimetres_for_metres_are_named_with_advice(room: Path) -> None:
    with pytest.raises(
        UsageError,
        match=r"\(read as mm\): mesh room: bad geometry\n  scale: .*0\.003 m .*metres taken for mill",
    ):
        read_mesh(room, unit="mm")
    for old, new in (("v 2 3 1", "v 2000 3000 1000"), ("v 0 3 0", "v 0 3000 0")):
        edited(room, old, new)
        with pytest.raises(UsageError, match=r"3000 m large.*millimetres taken for metres"):
            read_mesh(room)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("v 2 3 1", "v nan 3 1", "not finite"),
        ("f 5 8 7 6", "f 5 6 7 8", "inverted"),
        ("f 5 8 7 6", "f 5 8 7 6\nf 8 7 6 5", "duplicate"),
        ("f 5 8 7 6", "f 5 8 7 6\nf 5 5 6", "degenerate"),
        ("f 5 8 7 6", "f 5 8 7 6\nv 1 1 -1\nv 1 2 -1\nv 1 2 0.5\nf 9 10 11", "intersecting"),
        ("f 5 8 7 6", "f 5 8 7 6\nv 1 1 0\nv 1.5 1 0\nv 1 2 0\nf 9 10 11", "overlapping"),
    ],
)
def test_bad_geometry_is_refused_with_file_kind_and_place(room: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(UsageError, match=rf"room\.obj \(read as m\): mesh room: bad geometry\n  {message}: .* at \("):
        read_mesh(edited(room, old, new))


def test_an_open_file_called_closed_is_refused(room: Path) -> None:
    with pytest.raises(UsageError, match=r"open: 4 patches.*closed=False"):
        read_mesh(edited(room, "f 4 8 5 1\n", ""), closed=True)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("room.off", b"OFF", r"unknown mesh format '\.off'; there are \.obj"),
        ("room.stl", b"nonsense", "no faces in it"),
        ("room.glb", b"nonsense", "cannot be read as GLB"),
        ("room.ply", b"nonsense", "cannot be read as PLY"),
        ("room.gltf", b"{", "cannot be read as GLTF"),
        ("room.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 9\n", "line 3 has corners 1 2 9, there are 1 ... 2"),
        ("room.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 -3\n", "line 3 has corners 1 2 -3"),
        ("room.obj", b"v 0 0 0\nv 1 0 0\nf 1 2\n", "line 3 has 2 corners"),
        ("room.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 x\n", "cannot be read as OBJ: line 3"),
        ("room.obj", b"v 0 0\n", "cannot be read as OBJ: line 1"),
        ("room.obj", b"v 0 0 0\nv 1 0 0\n", "no faces in it"),
        ("room.obj", b"", "no faces in it"),
    ],
)
def test_files_that_are_no_mesh_are_refused(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UsageError, match=message) as refusal:
        read_mesh(tmp_path / name, reflectance=0.5)
    assert name in str(refusal.value)


L_FLOOR = "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\n"


@pytest.mark.parametrize("face", ["f 1 2 3 4 5 6", "f -6 -5 -4 -3 -2 -1", "f 1// 2// 3// \\\n 4// 5// 6//"])
def test_an_l_shaped_floor_is_one_polygon_of_an_obj(tmp_path: Path, face: str) -> None:
    (tmp_path / "floor.obj").write_text(L_FLOOR + face + "\n", encoding="utf-8")
    mesh = read_mesh(tmp_path / "floor.obj", reflectance=0.5)
    assert mesh.areas.sum() == pytest.approx(3.0)
    assert np.allclose(mesh.normals, (0, 0, 1))


def test_a_polygon_whose_edges_cross_is_refused_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "floor.obj").write_text(L_FLOOR + "f 1 3 2 6 5\nf 1 3 2 6 4\n", encoding="utf-8")
    with pytest.raises(UsageError, match="line 7: its edges cross each other; line 8"):
        read_mesh(tmp_path / "floor.obj", reflectance=0.5)


L_FACE = "6 0 1 2 3 4 5"


def ply_of(faces: list[str], header: str = "") -> str:
    corners = "".join(line[2:] + "\n" for line in L_FLOOR.splitlines())
    return (
        "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\n{header}end_header\n{corners}"
        + "".join(face + "\n" for face in faces)
    )


def test_a_ply_has_polygons_of_any_number_of_corners_each_with_its_colour(tmp_path: Path) -> None:
    header = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    text = ply_of(["4 0 1 3 5 255 255 255", "3 1 2 3 0 0 0"], header)
    (tmp_path / "floor.ply").write_text(text, encoding="ascii")
    mesh = read_mesh(tmp_path / "floor.ply")
    assert mesh.areas[mesh.reflectance == 1].sum() == pytest.approx(2.0)
    assert mesh.areas[mesh.reflectance == 0].sum() == pytest.approx(0.5)


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_binary_ply_may_mix_faces_and_has_an_order_of_bytes(tmp_path: Path, order: str) -> None:
    name = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = ply_of([L_FACE, "3 0 1 3"]).split("end_header")[0].replace("ascii", name) + "end_header\n"
    points = np.array([line.split()[1:] for line in L_FLOOR.splitlines()], dtype=float)
    faces = b"".join(bytes([len(f)]) + np.array(f, order + "i4").tobytes() for f in ([0, 1, 2, 3, 4, 5], [0, 1, 3]))
    (tmp_path / "floor.ply").write_bytes(head.encode() + points.astype(order + "f4").tobytes() + faces)
    assert read_triangles(tmp_path / "floor.ply").triangles.shape == (5, 3)
    (tmp_path / "floor.ply").write_bytes(head.encode() + points.astype(order + "f4").tobytes() + faces[:-3])
    with pytest.raises(UsageError, match="cannot be read as PLY"):
        read_triangles(tmp_path / "floor.ply")


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        (["3 0 1 9"], r"face 0 has corners 0 1 9, there are 0 \.\.\. 5"),
        ([L_FACE, "2 0 1"], "face 1 has 2 corners"),
        (["5 0 2 1 5 4"], "face 0: its edges cross"),
        (["4 0 1 2"], "is cut short"),
    ],
)
def test_faces_of_a_ply_that_are_none_are_refused_by_number(tmp_path: Path, faces: list[str], message: str) -> None:
    (tmp_path / "floor.ply").write_text(ply_of(faces), encoding="ascii")
    with pytest.raises(UsageError, match=message):
        read_mesh(tmp_path / "floor.ply", reflectance=0.5)


def test_an_stl_is_a_soup_that_hangs_together(room: Path) -> None:
    trimesh.load_mesh(room, process=False).export(room.with_suffix(".stl"))
    mesh = read_mesh(room.with_suffix(".stl"), reflectance=0.7)
    assert mesh.n_patches == 6
    assert mesh.closed


@pytest.mark.parametrize(
    ("up", "size"), [("x", (3, 1, 2)), ("y", (2, 1, 3)), ("z", (2, 3, 1)), ("-x", (3, 1, 2)), ("-z", (2, 3, 1))]
)
def test_any_axis_may_point_up_and_nothing_is_mirrored(room: Path, up: UpAxis, size: tuple[int, int, int]) -> None:
    mesh = read_mesh(room, up=up)
    assert np.ptp(mesh.vertices.reshape(-1, 3), axis=0) == pytest.approx(size)
    assert mesh.closed
    upwards = "xyz".index(up[-1])
    as_it_is = read_mesh(room)
    highest = np.sort(as_it_is.vertices.reshape(-1, 3)[:, upwards] * (-1 if up[0] == "-" else 1))
    assert np.sort(mesh.vertices.reshape(-1, 3)[:, 2]) == pytest.approx(highest)


def test_a_missing_file_and_an_unknown_unit_are_refused(tmp_path: Path, room: Path) -> None:
    with pytest.raises(UsageError, match="no such file"):
        read_mesh(tmp_path / "nothing.obj")
    with pytest.raises(UsageError, match="unknown unit 'yd'; there are m, cm"):
        read_mesh(room, unit="yd")  # type: ignore[arg-type]


def test_a_material_with_a_picture_has_no_colour(room: Path) -> None:
    from PIL import Image

    Image.new("RGB", (2, 2), (10, 20, 30)).save(room.parent / "wood.png")
    (room.parent / "room.mtl").write_text(MTL + "map_Kd wood.png\n", encoding="utf-8")
    with pytest.raises(UsageError, match="8 of 12 triangles have no colour"):
        read_mesh(room)
    mesh = read_mesh(room, reflectance=0.25)
    assert sorted(mesh.reflectance) == pytest.approx([0.25] * 4 + [0.8] * 2)


def test_the_rounding_of_float32_files_splits_no_wall_and_makes_no_shadow(tmp_path: Path) -> None:
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    for scene, convex, occluders in ((paper_room(patch_size_m=0.1), True, 0), (room_with_box(0.1), False, 5)):
        corners = np.arange(4 * scene.n_patches).reshape(-1, 4)
        triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [2, 3, 0]]])
        points = scene.vertices.reshape(-1, 3) @ turn.T
        trimesh.Trimesh(points, triangles, process=False).export(tmp_path / "turned.glb")
        mesh = read_mesh(tmp_path / "turned.glb", reflectance=0.7, colours=False)
        assert mesh.n_patches == scene.n_patches
        assert mesh.convex == convex
        assert mesh.closed == convex
        assert len(np.unique(mesh.region)) == len(scene.faces)
        assert len(mesh.occluders) == occluders

"""Renders the frames of one prepared scene with Blender Cycles; runs alone in a Python that has `bpy`.

    python render.py WORK

WORK holds `scene.json`, `body.npz` and `pictures/`, as `prepare.py` writes them. Each frame goes to
`frames/000000.png` (16 bits, sRGB, two stops under so that highlights keep their detail) under a temporary name first,
so an interrupted rendering goes on where it stopped. One thread, and no more of the machine than that.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

# Cycles keeps to its thread count, the denoiser does not: one processor is all that either may see.
os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

import bpy  # noqa: E402
import numpy as np  # noqa: E402
from mathutils import Matrix  # noqa: E402

FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
"""Blender's camera looks along -z with y up."""
EXPOSURE = -2.0
"""Stops, taken off by the camera and given back in `develop.py`."""


def warm_colour(warm: float) -> tuple[float, float, float]:
    return (1.0 + 0.5 * warm, 1.0, 1.0 - 0.9 * warm)


def material(name: str, look: dict, pictures: Path, uv: bool) -> bpy.types.Material:
    """A principled surface whose picture lies on it by its coordinates, or along the three axes of the object."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    shader = nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = look.get("roughness", 0.6)
    shader.inputs["Metallic"].default_value = look.get("metallic", 0.0)
    shader.inputs["Coat Weight"].default_value = look.get("coat", 0.0)
    shader.inputs["Coat Roughness"].default_value = 0.08
    image = nodes.new("ShaderNodeTexImage")
    image.image = bpy.data.images.load(str(pictures / f"{look['picture']}.png"), check_existing=True)
    links.new(image.outputs["Color"], shader.inputs["Base Color"])
    if not uv:
        image.projection, image.projection_blend = "BOX", 0.15
        place, scale = nodes.new("ShaderNodeTexCoord"), nodes.new("ShaderNodeMapping")
        scale.inputs["Scale"].default_value = (1.0 / look["span"],) * 3
        links.new(place.outputs["Object"], scale.inputs["Vector"])
        links.new(scale.outputs["Vector"], image.inputs["Vector"])
    if look.get("bump"):
        bump = nodes.new("ShaderNodeBump")
        bump.inputs["Strength"].default_value = look["bump"]
        bump.inputs["Distance"].default_value = 0.001
        links.new(image.outputs["Color"], bump.inputs["Height"])
        links.new(bump.outputs["Normal"], shader.inputs["Normal"])
    return made


def add_mesh(name: str, vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray | None = None) -> bpy.types.Object:
    """An object of triangles, or of faces given as lists; `uv` (v, 2) by vertex."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(np.asarray(vertices, float).tolist(), [], [list(map(int, f)) for f in faces])
    if uv is not None:
        layer = data.uv_layers.new(name="picture")
        order = np.empty(len(data.loops), np.int32)
        data.loops.foreach_get("vertex_index", order)
        layer.data.foreach_set("uv", np.asarray(uv, np.float32)[order].ravel())
    data.update()
    found = bpy.data.objects.new(name, data)
    bpy.context.collection.objects.link(found)
    return found


def add_thing(number: int, thing: dict, pictures: Path) -> bpy.types.Object:
    if thing["shape"] == "box":
        bpy.ops.mesh.primitive_cube_add(size=1.0)
        found = bpy.context.active_object
        found.data.transform(Matrix.Diagonal((*thing["size"], 1.0)))
    else:
        radius, height = thing["size"]
        bpy.ops.mesh.primitive_cylinder_add(vertices=64, radius=radius, depth=height)
        found = bpy.context.active_object
    found.matrix_world = Matrix(thing["pose"])
    found.data.materials.append(material(f"thing{number}", thing["surface"], pictures, uv=False))
    return found


def add_lights(scene: dict) -> None:
    """Lamps that face the origin: squares of a size [m] and power [W], or a sun of an angle [rad] and power [W/m^2]."""
    for i, lamp in enumerate(scene["lights"]):
        data = bpy.data.lights.new(f"lamp{i}", "SUN" if "sun" in lamp else "AREA")
        data.energy, data.color = lamp["watts"], warm_colour(lamp["warm"])
        if "sun" in lamp:
            data.angle = lamp["sun"]
        else:
            data.size = lamp["size"]
        found = bpy.data.objects.new(f"lamp{i}", data)
        bpy.context.collection.objects.link(found)
        found.location = lamp["at"]
        found.rotation_euler = (-found.location).to_track_quat("-Z", "Y").to_euler()
    world = bpy.data.worlds.new("room")
    bpy.context.scene.world = world
    world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (*warm_colour(scene["ambient"]["warm"]), 1.0)
    background.inputs["Strength"].default_value = scene["ambient"]["strength"]


def set_up(scene: dict) -> None:
    """Size, samples, threads; nothing of the machine's settings decides."""
    s = bpy.context.scene
    s.render.engine = "CYCLES"
    s.cycles.device, s.cycles.samples, s.cycles.seed = "CPU", scene["samples"], 0
    s.cycles.use_adaptive_sampling = False
    s.cycles.use_denoising, s.cycles.denoiser = True, "OPENIMAGEDENOISE"
    # each of the guides' own filterings costs as much as the picture's
    s.cycles.denoising_prefilter, s.cycles.denoising_quality = "FAST", "BALANCED"
    s.cycles.max_bounces, s.cycles.diffuse_bounces, s.cycles.glossy_bounces = 4, 2, 2
    s.cycles.caustics_reflective = s.cycles.caustics_refractive = False
    s.render.threads_mode, s.render.threads = "FIXED", 1
    s.render.use_persistent_data = True
    s.render.resolution_x, s.render.resolution_y = scene["size"]
    s.render.resolution_percentage = 100
    s.render.use_motion_blur, s.render.motion_blur_shutter = True, 2.0
    s.render.image_settings.file_format, s.render.image_settings.color_depth = "PNG", "16"
    s.render.image_settings.color_mode, s.render.image_settings.compression = "RGB", 15
    if scene.get("rolling"):
        # rows from the first to the last between the shutter's opening and closing, each exposed for a hundredth of that
        s.cycles.rolling_shutter_type, s.cycles.rolling_shutter_duration = "TOP", 0.01
    if scene.get("coverage"):
        s.render.film_transparent, s.render.image_settings.color_mode = True, "RGBA"
    s.view_settings.view_transform, s.view_settings.exposure = "Standard", EXPOSURE
    s.frame_set(1)


def add_flash(camera: bpy.types.Object, away: float) -> None:
    """A telephone's lamp beside its lens, bright enough for what lies `away` [m]."""
    data = bpy.data.lights.new("flash", "AREA")
    data.size, data.energy = 0.006, 8.0 * away**2
    found = bpy.data.objects.new("flash", data)
    bpy.context.collection.objects.link(found)
    found.parent, found.location = camera, (0.012, 0.01, 0.0)


def add_camera(scene: dict) -> bpy.types.Object:
    data = bpy.data.cameras.new("camera")
    data.sensor_fit, data.sensor_width = "HORIZONTAL", 36.0
    data.lens = 36.0 * scene["focal"] / scene["size"][0]
    data.clip_start, data.clip_end = 0.01, 1000.0
    found = bpy.data.objects.new("camera", data)
    bpy.context.collection.objects.link(found)
    bpy.context.scene.camera = found
    return found


def frame_window(window: list | None) -> None:
    """Draws a part of the image alone, (left, bottom, right, top) as fractions of it; the rest stays black."""
    render = bpy.context.scene.render
    render.use_border = window is not None
    if window is not None:
        render.border_min_x, render.border_min_y, render.border_max_x, render.border_max_y = window


def place(thing: bpy.types.Object, poses: list) -> None:
    """Moves a thing through its poses at the shutter's opening, middle and closing (frames 0, 1, 2)."""
    thing.rotation_mode = "QUATERNION"
    last = None
    for frame, pose in enumerate(poses):
        where, turn, _ = Matrix(pose).decompose()
        if last is not None and turn.dot(last) < 0:
            turn.negate()
        last = turn
        thing.location, thing.rotation_quaternion = where, turn
        thing.keyframe_insert("location", frame=frame)
        thing.keyframe_insert("rotation_quaternion", frame=frame)


def add_body(scene: dict, work: Path) -> bpy.types.Object:
    """The object: one surface, or a list of them with the `part` of each face."""
    pictures = work / "pictures"
    with np.load(work / "body.npz", allow_pickle=False) as z:
        uv = z["uv"] if "uv" in z.files else None
        body = add_mesh("body", z["vertices"], z["faces"], uv)
        part = z["part"] if "part" in z.files else np.zeros(len(z["faces"]))
    surfaces = scene["body"] if isinstance(scene["body"], list) else [scene["body"]]
    for number, look in enumerate(surfaces):
        body.data.materials.append(material(f"body{number}", look, pictures, uv is not None))
    body.data.polygons.foreach_set("material_index", part.astype(np.int32))
    body.data.polygons.foreach_set("use_smooth", [bool(surfaces[int(k)].get("smooth")) for k in part])
    return body


def main(work: Path) -> None:
    """Renders what is missing."""
    scene = json.loads((work / "scene.json").read_text())
    missing = [i for i in range(len(scene["frames"])) if not (work / "frames" / f"{i:06d}.png").is_file()]
    (work / "frames").mkdir(exist_ok=True)
    if not missing:
        return
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.preferences.edit.keyframe_new_interpolation_type = "LINEAR"
    set_up(scene)
    body = add_body(scene, work)
    moving = [body]
    movers = ["body"]
    for i, thing in enumerate(scene["things"]):
        made = add_thing(i, thing, work / "pictures")
        if thing["moves"]:
            moving.append(made)
            movers.append(thing["moves"])
    add_lights(scene)
    camera = add_camera(scene)
    if scene.get("flash"):
        add_flash(camera, float(np.linalg.norm(np.array(scene["frames"][0]["camera"][1])[:3, 3])))
    if scene.get("focus"):
        camera.data.dof.use_dof, camera.data.dof.focus_object, camera.data.dof.aperture_fstop = True, body, 2.0
    for i in missing:
        frame = scene["frames"][i]
        place(camera, [np.array(p) @ FROM_OPENCV for p in frame["camera"]])
        for thing, name in zip(moving, movers, strict=True):
            place(thing, frame[name])
        temporary = work / "frames" / f"rendering.{os.getpid()}.png"
        frame_window(frame.get("window"))
        bpy.context.scene.frame_set(1)
        bpy.context.scene.render.filepath = str(temporary)
        bpy.ops.render.render(write_still=True)
        temporary.replace(work / "frames" / f"{i:06d}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))

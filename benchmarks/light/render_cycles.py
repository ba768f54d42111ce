"""A room in Blender's Cycles with portals and Open Image Denoise; run by a Python that has ``bpy``, not by ours.

    PYTHON render_cycles.py room.npz out.npz SAMPLES HEIGHT

``room.npz``: triangles (N, 3, 3), part (N,), colour and emission (parts, 3), panes (p, 3, 3: corner, across, up), sky
(h, 2 h, 3, centre towards +y), sun (7: direction, illuminance; empty without one), eye (3). ``out.npz``: picture
(H, 2 H, 3), and cpu_s, the CPU seconds of the render call without Blender's start.

With ``photograph`` (h, 2 h, 3) beside, furniture is put into it as a shadow catcher does: parts whose number is below
``shell`` are the room and give off the light that the photograph shows at them, but for part ``floor``, which catches
shadows and bounces light; the rest is furniture (``rough`` (parts,): roughness, 1 is matte; ``metal`` (parts,)), and
``glass`` triangles (M, 3, 3) shine as panes do in the photograph and let the sun in. ``out.npz`` then holds furniture
(H, 2 H, 4), premultiplied, and caught (H, 2 H, 3), by which the photograph is multiplied.
"""

import math
import sys
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector


def main(source, target, samples, height):
    data = np.load(source)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if "photograph" in data:
        composite(data, target, samples, height)
        return
    scene = bpy.context.scene
    for part in np.unique(data["part"]):
        add_mesh(data["triangles"][data["part"] == part], data["colour"][part], data["emission"][part])
    for corner, across, up in data["panes"]:
        add_portal(corner, across, up)
    add_world(data["sky"])
    if len(data["sun"]):
        add_sun(data["sun"][:3], data["sun"][3:6])
    add_camera(data["eye"])
    settings(scene, samples, height)
    folder = Path(tempfile.mkdtemp())
    scene.render.filepath = str(folder / "out.exr")
    start = time.process_time()
    bpy.ops.render.render(write_still=True)
    cpu_s = time.process_time() - start
    shown = bpy.data.images.load(str(folder / "out.exr"))
    values = np.empty(height * 2 * height * 4, np.float32)
    shown.pixels.foreach_get(values)
    np.savez(target, picture=values.reshape(height, 2 * height, 4)[::-1, :, :3], cpu_s=cpu_s)


def composite(data, target, samples, height):
    shown, eye = picture_of(data["photograph"]), data["eye"]
    shell = int(data["shell"])
    for part in np.unique(data["part"]):
        triangles, colour = data["triangles"][data["part"] == part], data["colour"][part]
        if part == data["floor"]:
            add_mesh(triangles, colour, np.zeros(3)).is_shadow_catcher = True
        elif part < shell:
            add_shining(triangles, shown, eye)
        else:
            add_mesh(triangles, colour, data["emission"][part], float(data["rough"][part]), float(data["metal"][part]))
    if len(data["glass"]):
        add_shining(data["glass"], shown, eye).visible_shadow = False  # or it would keep the sun out
    if len(data["sun"]):
        add_sun(data["sun"][:3], data["sun"][3:6])
    add_camera(eye)
    settings(bpy.context.scene, samples, height)
    scene, layer = bpy.context.scene, bpy.context.view_layer
    scene.cycles.filter_width = 1.0
    scene.render.film_transparent = True
    layer.cycles.use_pass_shadow_catcher = True
    scene.render.image_settings.media_type = "MULTI_LAYER_IMAGE"
    scene.render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(Path(target).with_suffix(".exr"))
    start = time.process_time()
    bpy.ops.render.render(write_still=True)
    np.savez(target, cpu_s=time.process_time() - start)


def picture_of(rgb):
    high, wide = rgb.shape[:2]
    image = bpy.data.images.new("panorama", wide, high, float_buffer=True, is_data=True)
    # Blender's pictures of the world look along +x in the middle.
    turned = np.roll(rgb, -wide // 4, axis=1)[::-1]
    image.pixels.foreach_set(np.concatenate([turned, np.ones((high, wide, 1), np.float32)], axis=2).ravel())
    return image


def add_shining(triangles, image, eye):
    """Add a mesh that gives off what the photograph shows at it, unseen by the camera."""
    item = add_mesh(triangles, np.zeros(3), np.zeros(3))
    nodes, links = item.data.materials[0].node_tree.nodes, item.data.materials[0].node_tree.links
    nodes.clear()
    place, ray = nodes.new("ShaderNodeNewGeometry"), nodes.new("ShaderNodeVectorMath")
    texture, shader = nodes.new("ShaderNodeTexEnvironment"), nodes.new("ShaderNodeEmission")
    ray.operation, texture.image = "SUBTRACT", image
    ray.inputs[1].default_value = tuple(float(v) for v in eye)
    links.new(place.outputs["Position"], ray.inputs[0])
    links.new(ray.outputs[0], texture.inputs["Vector"])
    links.new(texture.outputs["Color"], shader.inputs["Color"])
    links.new(shader.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    # A catcher too: Cycles compares with what catchers alone give.
    item.visible_camera, item.is_shadow_catcher = False, True
    return item


def add_mesh(triangles, colour, emission, rough=1.0, metal=0.0):
    mesh = bpy.data.meshes.new("part")
    mesh.from_pydata(triangles.reshape(-1, 3).tolist(), [], np.arange(3 * len(triangles)).reshape(-1, 3).tolist())
    material = bpy.data.materials.new("part")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    out = nodes.new("ShaderNodeOutputMaterial")
    if emission.any():
        shader = nodes.new("ShaderNodeEmission")
        shader.inputs["Strength"].default_value = float(emission.max())
        shader.inputs["Color"].default_value = (*(float(v) for v in emission / emission.max()), 1.0)
    elif rough < 1 or metal > 0:
        shader = nodes.new("ShaderNodeBsdfPrincipled")
        shader.inputs["Base Color"].default_value = (*(float(v) for v in colour), 1.0)
        shader.inputs["Roughness"].default_value, shader.inputs["Metallic"].default_value = rough, metal
    else:
        shader = nodes.new("ShaderNodeBsdfDiffuse")
        shader.inputs["Color"].default_value = (*(float(v) for v in colour), 1.0)
    links.new(shader.outputs[0], out.inputs["Surface"])
    mesh.materials.append(material)
    item = bpy.data.objects.new("part", mesh)
    bpy.context.collection.objects.link(item)
    return item


def add_portal(corner, across, up):
    light = bpy.data.lights.new("portal", "AREA")
    light.shape, light.size, light.size_y = "RECTANGLE", float(np.linalg.norm(across)), float(np.linalg.norm(up))
    light.cycles.is_portal = True
    item = bpy.data.objects.new("portal", light)
    x, y = Vector(across).normalized(), Vector(up).normalized()
    z = x.cross(y)  # a lamp shines along -z; the pane's across x up looks outside or inside: turn it inside
    middle = Vector(corner + across / 2 + up / 2)
    if z.dot(middle) < 0:
        x, z = -x, -z
    turn = Matrix((x, y, z)).transposed().to_4x4()
    item.matrix_world = Matrix.Translation(middle) @ turn
    bpy.context.collection.objects.link(item)


def add_world(sky):
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    nodes.clear()
    texture, back = nodes.new("ShaderNodeTexEnvironment"), nodes.new("ShaderNodeBackground")
    out = nodes.new("ShaderNodeOutputWorld")
    texture.image = picture_of(sky)
    links.new(texture.outputs["Color"], back.inputs["Color"])
    links.new(back.outputs[0], out.inputs["Surface"])
    bpy.context.scene.world = world


def add_sun(direction, illuminance):
    light = bpy.data.lights.new("sun", "SUN")
    light.angle = math.radians(0.53)
    light.energy = float(illuminance.max())
    light.color = tuple(float(v) for v in illuminance / illuminance.max())
    item = bpy.data.objects.new("sun", light)
    item.rotation_mode = "QUATERNION"
    item.rotation_quaternion = Vector(direction).to_track_quat("Z", "Y")
    bpy.context.collection.objects.link(item)


def add_camera(eye):
    camera = bpy.data.cameras.new("camera")
    camera.type = "PANO"
    camera.panorama_type = "EQUIRECTANGULAR"
    item = bpy.data.objects.new("camera", camera)
    item.location, item.rotation_euler = tuple(float(v) for v in eye), (math.pi / 2, 0.0, 0.0)
    bpy.context.collection.objects.link(item)
    bpy.context.scene.camera = item


def settings(scene, samples, height):
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.use_adaptive_sampling = "CPU", samples, False
    cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
    cycles.denoising_input_passes, cycles.denoising_prefilter = "RGB_ALBEDO_NORMAL", "ACCURATE"
    cycles.max_bounces = cycles.diffuse_bounces = 32
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 0.01
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.resolution_x, scene.render.resolution_y = 2 * height, height
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.view_settings.view_transform = "Raw"


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))

"""Run by a Python that has ``bpy``: import a GLB, print its bones, actions and posed vertices (y up) as JSON."""

import json
import math
import sys

import numpy as np


def vertices(mesh) -> np.ndarray:
    bpy.context.view_layer.update()
    evaluated = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
    data = evaluated.to_mesh()
    flat = np.empty(3 * len(data.vertices), np.float32)
    data.vertices.foreach_get("co", flat)
    matrix = np.array(evaluated.matrix_world)
    placed = flat.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
    evaluated.to_mesh_clear()
    return np.stack((placed[:, 0], placed[:, 2], -placed[:, 1]), axis=1)  # Blender has z up


def show(armature, action, time: float) -> None:
    animation = armature.animation_data or armature.animation_data_create()
    for track in animation.nla_tracks:
        track.mute = True
    animation.action = action
    animation.action_slot = action.slots[0]
    scene = bpy.context.scene
    frame = time * scene.render.fps / scene.render.fps_base
    scene.frame_set(math.floor(frame), subframe=frame - math.floor(frame))


def main(path: str, wanted: dict[str, float], out: str) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=path, merge_vertices=False)
    (armature,) = [each for each in bpy.data.objects if each.type == "ARMATURE"]
    (mesh,) = [each for each in bpy.data.objects if any(m.type == "ARMATURE" for m in each.modifiers)]
    bones = {bone.name: list((bone.tail_local - bone.head_local).normalized()) for bone in armature.data.bones}
    posed = {}
    for name, time in wanted.items():
        (action,) = [each for each in bpy.data.actions if each.name == name]
        show(armature, action, time)
        posed[name] = vertices(mesh).tolist()
    with open(out, "w") as file:
        json.dump({"bones": bones, "actions": sorted(each.name for each in bpy.data.actions), "posed": posed}, file)


if __name__ == "__main__":
    import bpy

    main(sys.argv[1], json.loads(sys.argv[2]), sys.argv[3])

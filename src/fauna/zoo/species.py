"""The species of the zoo by their true proportions: the even-toed, odd-toed and trunked. See ``beasts`` for the clawed."""

from dataclasses import replace

from fauna.zoo.anatomy import Anatomy, Bump, Ear, Horn, Tail

HORSE = Anatomy(
    length=1.06, chest=0.45, belly=0.42, rump=0.43, croup=0.99, arch=-0.025, width=0.74,
    neck_length=0.60, neck_deg=45.0, neck_arch=0.06, neck_root=0.185, neck_top=0.098, neck_width=0.55, neck_drop=0.40,
    head=0.41, head_deg=48.0, skull=0.215, muzzle=(0.155, 0.125), muzzle_drop=0.03, muzzle_start=0.45, jaw=0.19, head_width=0.72,
    eye=(0.06, 0.34), eye_radius=0.05, stance=0.105, knee=0.295, hock=0.36, fetlock=0.13, angulation=1.0,
    thigh=0.18, gaskin=0.062, shoulder=0.15, forearm=0.085, cannon=0.036, foot=0.052, foot_length=0.055, hoof=True,
    ear=Ear(place=(0.10, 0.17, 0.05), direction=(0.25, 1.0, -0.45), length=0.34, width=0.17, profile="leaf"),
    tail=Tail(length=0.72, angle_deg=-48.0, curl_deg=-40.0, radii=(0.03, 0.065, 0.065, 0.02), tuft=0.92),
    crest=0.055,
    bumps=(Bump(bone="head", start=(0.07, 0.02), end=(0.06, 0.09), radii=(0.045, 0.025), width=0.7, material="mane"),),
)  # fmt: skip

ZEBRA = replace(
    HORSE, length=1.12, neck_length=0.50, neck_deg=42.0, neck_root=0.19, neck_top=0.11, neck_width=0.6, head=0.42, belly=0.48, width=0.78,
    ear=Ear(place=(0.12, 0.17, 0.05), direction=(0.35, 1.0, -0.4), length=0.40, width=0.24, profile="leaf"),
    tail=Tail(length=0.62, angle_deg=-45.0, curl_deg=-50.0, radii=(0.03, 0.022, 0.03, 0.03), tuft=0.4),
    crest=0.06,
)  # fmt: skip

COW = replace(
    HORSE, crest=0.0, length=1.24, chest=0.52, belly=0.54, rump=0.48, croup=1.0, arch=-0.03, width=0.70,
    neck_length=0.42, neck_deg=16.0, neck_arch=0.02, neck_root=0.185, neck_top=0.115, neck_width=0.55, neck_drop=0.34,
    head=0.43, head_deg=44.0, skull=0.23, muzzle=(0.19, 0.17), muzzle_drop=0.03, muzzle_start=0.45, jaw=0.19, head_width=0.85,
    eye=(0.07, 0.36), knee=0.26, hock=0.33, fetlock=0.11, angulation=0.85, thigh=0.19, gaskin=0.06, forearm=0.085, cannon=0.04, foot=0.058,
    ear=Ear(place=(0.17, 0.12, 0.10), direction=(1.0, 0.1, -0.25), length=0.36, width=0.2, profile="leaf"),
    tail=Tail(length=0.72, angle_deg=-55.0, curl_deg=-42.0, radii=(0.032, 0.018, 0.018, 0.035), tuft=0.2),
    horns=(Horn(path=((0.14, 0.2, 0.03), (0.34, 0.28, 0.05), (0.42, 0.45, 0.16)), radius=0.06),),
    bumps=(
        Bump(bone="neck0", start=(-0.22, 0.02), end=(-0.2, 0.2), radii=(0.06, 0.05), width=0.35),
        Bump(bone="pelvis", start=(-0.22, 0.05), end=(-0.25, 0.13), radii=(0.11, 0.07), width=1.1, material="udder"),
    ),
)  # fmt: skip

GIRAFFE = replace(
    HORSE, length=0.72, chest=0.33, belly=0.30, rump=0.30, croup=0.84, arch=0.0, width=0.66,
    neck_length=0.74, neck_deg=62.0, neck_arch=-0.01, neck_root=0.125, neck_top=0.055, neck_width=0.62, neck_drop=0.34,
    head=0.25, head_deg=28.0, skull=0.2, muzzle=(0.15, 0.115), muzzle_drop=0.05, muzzle_start=0.42, jaw=0.15, head_width=0.72,
    eye=(0.06, 0.34), eye_radius=0.055, stance=0.075, knee=0.36, hock=0.34, fetlock=0.10, angulation=0.55,
    thigh=0.115, gaskin=0.045, shoulder=0.105, forearm=0.062, cannon=0.028, foot=0.038, foot_length=0.03,
    ear=Ear(place=(0.15, 0.12, 0.04), direction=(1.0, 0.45, -0.35), length=0.38, width=0.18, profile="leaf"),
    tail=Tail(length=0.45, angle_deg=-50.0, curl_deg=-45.0, radii=(0.022, 0.011, 0.014, 0.024), tuft=0.3),
    horns=(Horn(path=((0.08, 0.15, 0.12), (0.10, 0.30, 0.05), (0.11, 0.44, 0.0)), radius=0.05, tip=1.2),),
    crest=0.026, bumps=(),
)  # fmt: skip

ELEPHANT = replace(
    HORSE, crest=0.0, length=1.10, chest=0.56, belly=0.60, rump=0.58, croup=0.98, arch=0.04, width=0.74,
    neck_length=0.24, neck_deg=22.0, neck_arch=0.0, neck_root=0.23, neck_top=0.19, neck_width=0.75, neck_drop=0.32,
    head=0.40, head_deg=62.0, skull=0.42, muzzle=(0.30, 0.20), muzzle_drop=0.0, muzzle_start=0.5, jaw=0.22, head_width=0.8,
    eye=(0.12, 0.5), eye_radius=0.032, stance=0.15, knee=0.24, hock=0.22, fetlock=0.08, angulation=0.25,
    thigh=0.17, gaskin=0.10, shoulder=0.16, forearm=0.12, cannon=0.088, foot=0.098, foot_length=0.02,
    ear=Ear(place=(0.36, 0.12, 0.30), direction=(0.72, -0.80, 0.10), length=1.0, width=1.15, profile="round", thickness=0.035,
            facing=(0.75, 0.55, 0.3)),
    tail=Tail(length=0.5, angle_deg=-60.0, curl_deg=-30.0, radii=(0.03, 0.014, 0.012, 0.02), tuft=0.12),
    horns=(Horn(path=((0.19, -0.08, 0.86), (0.23, 0.0, 1.2), (0.22, 0.22, 1.5), (0.18, 0.45, 1.62)), radius=0.06, material="tusk"),),
    bumps=(), proboscis=0.51,
)  # fmt: skip

RHINO = replace(
    HORSE, crest=0.0, length=1.46, chest=0.60, belly=0.62, rump=0.55, croup=0.97, arch=-0.04, width=0.78,
    neck_length=0.34, neck_deg=-6.0, neck_arch=0.03, neck_root=0.23, neck_top=0.165, neck_width=0.7, neck_drop=0.34,
    head=0.54, head_deg=36.0, skull=0.27, muzzle=(0.19, 0.165), muzzle_drop=0.07, muzzle_start=0.5, jaw=0.2, head_width=0.78,
    eye=(0.06, 0.42), eye_radius=0.03, stance=0.19, knee=0.2, hock=0.23, fetlock=0.08, angulation=0.5,
    thigh=0.2, gaskin=0.105, shoulder=0.18, forearm=0.12, cannon=0.085, foot=0.095, foot_length=0.03,
    ear=Ear(place=(0.16, 0.26, 0.10), direction=(0.35, 1.0, -0.2), length=0.30, width=0.2, profile="leaf", thickness=0.06),
    tail=Tail(length=0.42, angle_deg=-70.0, curl_deg=-15.0, radii=(0.035, 0.018, 0.014, 0.02), tuft=0.15),
    horns=(
        Horn(path=((0.0, 0.06, 0.86), (0.0, 0.28, 0.92), (0.0, 0.52, 0.86), (0.0, 0.66, 0.74)), radius=0.11, tip=0.1, paired=False),
        Horn(path=((0.0, 0.13, 0.62), (0.0, 0.27, 0.63), (0.0, 0.36, 0.58)), radius=0.085, tip=0.15, paired=False),
    ),
    bumps=(Bump(bone="neck0", start=(0.10, -0.12), end=(0.08, 0.02), radii=(0.16, 0.14), width=0.7),),
)  # fmt: skip

_ANTLER = ((0.09, 0.2, 0.06), (0.25, 0.55, -0.12), (0.52, 0.95, -0.2), (0.6, 1.5, -0.02), (0.5, 1.85, 0.15))
DEER = replace(
    HORSE, crest=0.0, length=1.06, chest=0.42, belly=0.39, rump=0.39, croup=1.0, arch=0.0, width=0.64,
    neck_length=0.50, neck_deg=56.0, neck_arch=-0.03, neck_root=0.135, neck_top=0.075, neck_width=0.66, neck_drop=0.38,
    head=0.32, head_deg=30.0, skull=0.22, muzzle=(0.15, 0.10), muzzle_drop=0.06, muzzle_start=0.45, jaw=0.15, head_width=0.75,
    eye=(0.06, 0.36), eye_radius=0.06, stance=0.08, knee=0.31, hock=0.38, fetlock=0.12, angulation=0.95,
    thigh=0.15, gaskin=0.045, shoulder=0.12, forearm=0.062, cannon=0.025, foot=0.034, foot_length=0.04,
    ear=Ear(place=(0.13, 0.14, 0.04), direction=(1.0, 0.65, -0.3), length=0.46, width=0.25, profile="leaf"),
    tail=Tail(length=0.16, angle_deg=-45.0, curl_deg=-20.0, radii=(0.03, 0.035, 0.028, 0.01), tuft=0.5),
    horns=(
        Horn(path=_ANTLER, radius=0.05, tip=0.35, material="antler"),
        Horn(path=((0.14, 0.34, 0.0), (0.2, 0.5, 0.22), (0.22, 0.72, 0.36)), radius=0.034, tip=0.3, material="antler"),
        Horn(path=((0.42, 0.82, -0.18), (0.42, 0.95, 0.06), (0.44, 1.16, 0.18)), radius=0.034, tip=0.3, material="antler"),
        Horn(path=((0.58, 1.3, -0.1), (0.72, 1.52, -0.1), (0.76, 1.78, -0.04)), radius=0.032, tip=0.3, material="antler"),
    ),
    bumps=(),
)  # fmt: skip

SHEEP = replace(
    HORSE, crest=0.0, length=1.28, chest=0.60, belly=0.60, rump=0.57, croup=1.0, arch=0.02, width=0.84, fleece=0.022,
    neck_length=0.42, neck_deg=44.0, neck_arch=0.0, neck_root=0.2, neck_top=0.115, neck_width=0.8, neck_drop=0.36,
    head=0.40, head_deg=36.0, skull=0.24, muzzle=(0.18, 0.135), muzzle_drop=0.0, muzzle_start=0.45, jaw=0.18, head_width=0.75,
    eye=(0.07, 0.38), eye_radius=0.055, stance=0.125, knee=0.21, hock=0.26, fetlock=0.09, angulation=0.75,
    thigh=0.19, gaskin=0.05, shoulder=0.16, forearm=0.07, cannon=0.036, foot=0.046, foot_length=0.04,
    ear=Ear(place=(0.2, 0.12, 0.1), direction=(1.0, -0.15, -0.2), length=0.44, width=0.2, profile="leaf"),
    tail=Tail(length=0.24, angle_deg=-60.0, curl_deg=-25.0, radii=(0.07, 0.065, 0.05, 0.02)), horns=(),
    bumps=(
        Bump(bone="head", start=(0.05, -0.03), end=(0.06, 0.03), radii=(0.085, 0.065), material="wool"),
    ),
)  # fmt: skip

GOAT = replace(
    SHEEP, fleece=0.0, length=1.22, chest=0.53, belly=0.54, rump=0.48, croup=1.0, arch=-0.01, width=0.68,
    neck_length=0.44, neck_deg=52.0, neck_root=0.15, neck_top=0.10, neck_width=0.65, stance=0.1, thigh=0.17, shoulder=0.14,
    gaskin=0.052, knee=0.26, hock=0.31, head=0.36, head_deg=46.0,
    ear=Ear(place=(0.2, 0.12, 0.08), direction=(1.0, -0.2, -0.1), length=0.5, width=0.2, profile="leaf"),
    tail=Tail(length=0.2, angle_deg=55.0, curl_deg=20.0, radii=(0.035, 0.04, 0.03, 0.01)),
    horns=(
        Horn(path=((0.09, 0.22, 0.12), (0.14, 0.58, 0.0), (0.24, 0.78, -0.32), (0.34, 0.72, -0.68)), radius=0.075, tip=0.2),
        Horn(path=((0.0, -0.12, 0.66), (0.0, -0.34, 0.7), (0.0, -0.56, 0.66)), radius=0.08, paired=False, material="beard"),
    ),
    bumps=(),
)  # fmt: skip

CAMEL = replace(
    HORSE, crest=0.0, length=0.88, chest=0.40, belly=0.36, rump=0.34, croup=0.94, arch=0.02, width=0.72,
    neck_length=0.66, neck_deg=36.0, neck_arch=-0.14, neck_root=0.125, neck_top=0.072, neck_width=0.62, neck_drop=0.5,
    head=0.30, head_deg=16.0, skull=0.2, muzzle=(0.16, 0.14), muzzle_drop=0.05, muzzle_start=0.45, jaw=0.15, head_width=0.7,
    eye=(0.08, 0.36), stance=0.09, knee=0.31, hock=0.36, fetlock=0.08, angulation=0.65,
    thigh=0.125, gaskin=0.05, shoulder=0.115, forearm=0.065, cannon=0.035, foot=0.055, foot_length=0.05,
    ear=Ear(place=(0.13, 0.17, 0.04), direction=(0.5, 1.0, -0.5), length=0.22, width=0.14, profile="leaf"),
    tail=Tail(length=0.36, angle_deg=-60.0, curl_deg=-25.0, radii=(0.022, 0.014, 0.016, 0.02), tuft=0.3),
    bumps=(Bump(bone="loin", start=(0.13, 0.06), end=(0.32, 0.03), radii=(0.17, 0.075), width=0.75, material="hump"),),
)  # fmt: skip

PIG = replace(
    HORSE, crest=0.0, length=1.52, chest=0.66, belly=0.69, rump=0.62, croup=1.0, arch=0.05, width=0.80,
    neck_length=0.30, neck_deg=2.0, neck_arch=0.0, neck_root=0.27, neck_top=0.20, neck_width=0.82, neck_drop=0.42,
    head=0.52, head_deg=24.0, skull=0.32, muzzle=(0.185, 0.14), muzzle_drop=0.13, muzzle_start=0.5, jaw=0.25, head_width=0.85,
    eye=(0.12, 0.46), eye_radius=0.035, stance=0.16, knee=0.17, hock=0.22, fetlock=0.08, angulation=0.6,
    thigh=0.24, gaskin=0.075, shoulder=0.2, forearm=0.095, cannon=0.052, foot=0.06, foot_length=0.05,
    ear=Ear(place=(0.2, 0.26, 0.2), direction=(0.55, 0.9, 0.35), length=0.46, width=0.42, profile="triangle", thickness=0.05, facing=(0.9, -0.2, 0.7)),
    tail=Tail(length=0.36, angle_deg=20.0, curl_deg=-380.0, radii=(0.028, 0.02, 0.015, 0.01)), bumps=(),
)  # fmt: skip

HOOFED = {
    "horse": HORSE, "zebra": ZEBRA, "cow": COW, "giraffe": GIRAFFE, "elephant": ELEPHANT, "rhino": RHINO,
    "deer": DEER, "sheep": SHEEP, "goat": GOAT, "camel": CAMEL, "pig": PIG,
}  # fmt: skip

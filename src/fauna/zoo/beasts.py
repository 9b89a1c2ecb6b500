"""The species of the zoo by their true proportions: cats, dogs, bears and rabbits."""

from dataclasses import replace

from fauna.zoo.anatomy import Anatomy, Bump, Ear, Tail

DOG = Anatomy(
    length=1.10, chest=0.46, belly=0.34, rump=0.36, croup=0.98, arch=0.0, width=0.66,
    neck_length=0.38, neck_deg=50.0, neck_arch=0.0, neck_root=0.155, neck_top=0.11, neck_width=0.75, neck_drop=0.36,
    head=0.42, head_deg=18.0, skull=0.26, muzzle=(0.155, 0.105), muzzle_drop=0.11, muzzle_start=0.52, jaw=0.15, head_width=0.85,
    eye=(0.07, 0.50), eye_radius=0.047, stance=0.105, knee=0.20, hock=0.27, fetlock=0.07, angulation=1.25,
    thigh=0.15, gaskin=0.048, shoulder=0.115, forearm=0.068, cannon=0.04, foot=0.052, foot_length=0.055, hoof=False,
    ear=Ear(place=(0.19, 0.2, 0.12), direction=(0.8, -0.95, 0.1), length=0.44, width=0.28, profile="leaf"),
    tail=Tail(length=0.55, angle_deg=25.0, curl_deg=60.0, radii=(0.04, 0.035, 0.025, 0.012)),
)  # fmt: skip

FOX = replace(
    DOG, length=1.28, chest=0.46, belly=0.38, rump=0.38, neck_length=0.32, neck_deg=36.0, neck_root=0.16, neck_top=0.13, neck_width=0.8,
    head=0.48, head_deg=14.0, skull=0.26, muzzle=(0.13, 0.06), muzzle_drop=0.12, jaw=0.17, head_width=0.95, eye=(0.05, 0.50), eye_radius=0.045,
    ear=Ear(place=(0.17, 0.2, 0.14), direction=(0.35, 1.0, -0.1), length=0.40, width=0.30, profile="triangle", thickness=0.1),
    tail=Tail(length=1.0, angle_deg=-32.0, curl_deg=22.0, radii=(0.055, 0.125, 0.12, 0.03), tuft=0.22),
    cannon=0.036, foot=0.046, thigh=0.145,
)  # fmt: skip

WOLF = replace(
    DOG, length=1.16, chest=0.46, belly=0.37, rump=0.37, neck_length=0.36, neck_deg=30.0, neck_root=0.175, neck_top=0.125, neck_width=0.85,
    head=0.46, head_deg=14.0, skull=0.27, muzzle=(0.14, 0.09), muzzle_drop=0.13, jaw=0.2, head_width=0.95,
    ear=Ear(place=(0.16, 0.2, 0.12), direction=(0.35, 1.0, -0.1), length=0.30, width=0.24, profile="triangle", thickness=0.08),
    tail=Tail(length=0.62, angle_deg=-58.0, curl_deg=-10.0, radii=(0.05, 0.085, 0.075, 0.025), tuft=0.2), knee=0.21, hock=0.29, foot=0.052,
)  # fmt: skip

CAT = replace(
    DOG, length=1.42, chest=0.48, belly=0.46, rump=0.46, croup=1.0, arch=0.0, width=0.72,
    neck_length=0.30, neck_deg=42.0, neck_root=0.16, neck_top=0.145, neck_width=0.9, neck_drop=0.34,
    head=0.38, head_deg=12.0, skull=0.41, muzzle=(0.21, 0.15), muzzle_drop=0.12, muzzle_start=0.60, jaw=0.27, head_width=1.0,
    eye=(0.08, 0.72), eye_radius=0.075, stance=0.09, knee=0.17, hock=0.22, fetlock=0.06, angulation=1.2,
    thigh=0.17, gaskin=0.055, shoulder=0.12, forearm=0.07, cannon=0.048, foot=0.055, foot_length=0.05,
    ear=Ear(place=(0.24, 0.3, 0.28), direction=(0.4, 1.0, -0.1), length=0.38, width=0.42, profile="triangle", thickness=0.13),
    tail=Tail(length=1.0, angle_deg=-20.0, curl_deg=95.0, radii=(0.04, 0.036, 0.033, 0.02)),
)  # fmt: skip

LION = replace(
    CAT, length=1.42, chest=0.48, belly=0.42, rump=0.42, croup=0.97, arch=-0.015, width=0.66,
    neck_length=0.36, neck_deg=22.0, neck_root=0.18, neck_top=0.15, neck_width=0.85,
    head=0.38, head_deg=22.0, skull=0.33, muzzle=(0.23, 0.195), muzzle_drop=0.10, muzzle_start=0.55, jaw=0.27, head_width=0.92,
    eye=(0.10, 0.62), eye_radius=0.055, stance=0.115, knee=0.21, hock=0.25, thigh=0.165, forearm=0.08, cannon=0.056, foot=0.075,
    ear=Ear(place=(0.26, 0.27, 0.15), direction=(0.75, 1.0, -0.2), length=0.22, width=0.24, profile="round", thickness=0.05),
    tail=Tail(length=0.92, angle_deg=-55.0, curl_deg=55.0, radii=(0.035, 0.025, 0.02, 0.045), tuft=0.14),
    bumps=(
        Bump(bone="neck1", start=(0.04, -0.04), end=(-0.12, -0.06), radii=(0.23, 0.2), width=0.9, material="mane"),
        Bump(bone="neck2", start=(0.07, 0.04), end=(-0.1, 0.02), radii=(0.22, 0.19), width=1.0, material="mane"),
        Bump(bone="neck0", start=(-0.04, -0.02), end=(-0.2, 0.04), radii=(0.2, 0.17), width=0.85, material="mane"),
    ),
)  # fmt: skip

TIGER = replace(
    LION, length=1.50, neck_deg=20.0, neck_root=0.185, neck_top=0.15, head=0.37, skull=0.38, muzzle=(0.23, 0.185), muzzle_start=0.6, jaw=0.33,
    forearm=0.088, bumps=(),
    tail=Tail(length=0.95, angle_deg=-50.0, curl_deg=65.0, radii=(0.042, 0.036, 0.034, 0.024)),
)  # fmt: skip

BEAR = replace(
    DOG, length=1.42, chest=0.60, belly=0.60, rump=0.58, croup=0.97, arch=0.02, width=0.80,
    neck_length=0.36, neck_deg=8.0, neck_root=0.25, neck_top=0.19, neck_width=0.82, neck_drop=0.34,
    head=0.44, head_deg=20.0, skull=0.37, muzzle=(0.19, 0.125), muzzle_drop=0.14, muzzle_start=0.55, jaw=0.28, head_width=0.92,
    eye=(0.07, 0.58), eye_radius=0.038, stance=0.16, knee=0.14, hock=0.13, fetlock=0.055, angulation=0.75,
    thigh=0.225, gaskin=0.1, shoulder=0.19, forearm=0.125, cannon=0.085, foot=0.082, foot_length=0.12,
    ear=Ear(place=(0.28, 0.3, 0.22), direction=(0.6, 1.0, -0.1), length=0.22, width=0.26, profile="round", thickness=0.06),
    tail=Tail(length=0.1, angle_deg=-50.0, curl_deg=0.0, radii=(0.05, 0.05, 0.04, 0.02)),
    bumps=(Bump(bone="neck0", start=(0.08, -0.18), end=(0.02, -0.1), radii=(0.17, 0.16), width=0.85),),
)  # fmt: skip

RABBIT = replace(
    DOG, length=1.72, chest=0.62, belly=0.78, rump=0.86, croup=1.12, arch=0.10, width=0.80,
    neck_length=0.30, neck_deg=38.0, neck_root=0.25, neck_top=0.21, neck_width=0.9, neck_drop=0.34,
    head=0.58, head_deg=30.0, skull=0.36, muzzle=(0.26, 0.17), muzzle_drop=0.06, muzzle_start=0.45, jaw=0.26, head_width=0.78,
    eye=(0.10, 0.44), eye_radius=0.068, stance=0.15, knee=0.14, hock=0.11, fetlock=0.07, angulation=1.4,
    thigh=0.34, gaskin=0.09, shoulder=0.18, forearm=0.085, cannon=0.06, foot=0.068, foot_length=0.12,
    ear=Ear(place=(0.1, 0.28, 0.12), direction=(0.22, 1.0, -0.45), length=1.05, width=0.30, profile="leaf"),
    tail=Tail(length=0.22, angle_deg=35.0, curl_deg=30.0, radii=(0.08, 0.12, 0.1, 0.05), tuft=0.8),
)  # fmt: skip

CLAWED = {
    "dog": DOG,
    "fox": FOX,
    "wolf": WOLF,
    "cat": CAT,
    "lion": LION,
    "tiger": TIGER,
    "bear": BEAR,
    "rabbit": RABBIT,
}

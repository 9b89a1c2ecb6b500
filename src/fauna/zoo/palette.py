"""Coats each species may wear."""

from fauna.zoo.coat import Coat

_HOOF = ("hoof", "#2b241f")
_DARK_NOSE = ("nose", "#15110f")


def _horse(skin: str, mane: str, legs: str = "", muzzle: str = "") -> Coat:
    parts = (("mane", mane), ("tuft", mane), _HOOF, ("nose", muzzle or "#2a211d")) + (
        (("muzzle", muzzle),) if muzzle else ()
    )
    return Coat(skin=skin, legs=legs, parts=parts)


_COW_PARTS = (("nose", "#c79a8b"), ("horn", "#d8cbae"), ("udder", "#d9a594"), _HOOF, ("tuft", "#e6e0d6"))
_SHEEP_PARTS = (("face", "#453b35"), ("muzzle", "#3a322d"), ("nose", "#2b2421"), ("ear", "#5a4c43"), _HOOF)
_GOAT_PARTS = (("horn", "#57493b"), ("nose", "#3a2d28"), _HOOF)
_CAT_PARTS = (("nose", "#b0746c"), ("eye", "#8a9a2c"), ("ear", "#8c6a55"))

COATS: dict[str, tuple[Coat, ...]] = {
    "horse": (
        _horse("#7a4526", "#1c1512", legs="#1f1713"), _horse("#8f5426", "#96602f"), _horse("#2b2320", "#191413"),
        _horse("#b9b4ad", "#e0dcd4", legs="#6d6863", muzzle="#5b5552"), _horse("#c79a5b", "#efe2c4", muzzle="#8a6a4a"),
    ),
    "zebra": (Coat(skin="#e9e2d4", pattern="stripes", marks="#15110f", scale=0.125,
                   parts=(("nose", "#1a1513"), ("hoof", "#2b2622"), ("tuft", "#1b1613"))),),
    "cow": (
        Coat(skin="#e8e3da", pattern="patches", marks="#1a1614", scale=0.42, parts=_COW_PARTS),
        Coat(skin="#e8ddcb", pattern="patches", marks="#6e3518", scale=0.46, parts=_COW_PARTS),
        Coat(skin="#7b4322", legs="#5c2f18", parts=(*_COW_PARTS[:4], ("tuft", "#4a2816"))),
        Coat(skin="#c9a777", belly="#ddc8a6", parts=_COW_PARTS),
    ),
    "giraffe": (
        Coat(skin="#dcc391", pattern="net", marks="#94561f", scale=0.125, belly="#e6d5b1",
             parts=(("horn", "#33241a"), ("nose", "#6d5440"), ("tuft", "#1d1511"), ("mane", "#8a5a2e"), _HOOF)),
        Coat(skin="#d9bf94", pattern="net", marks="#6b3d1e", scale=0.11, belly="#e3d2b0",
             parts=(("horn", "#2b1f18"), ("nose", "#6d5440"), ("tuft", "#1d1511"), ("mane", "#6e472a"), _HOOF)),
    ),
    "elephant": tuple(
        Coat(skin=skin, parts=(("tusk", "#e9dfc8"), ("hoof", "#8d8378"), ("tuft", "#2d2926"), ("eye", "#20160f")))
        for skin in ("#77716b", "#86796d", "#6a6766")
    ),
    "rhino": tuple(Coat(skin=skin, parts=(("horn", "#4d453d"), ("hoof", "#4c463f"), ("tuft", "#37312d"))) for skin in ("#8b8680", "#7d7468", "#969089")),
    "deer": (
        Coat(skin="#8f5a34", belly="#d8c4a5", parts=(("antler", "#7d6444"), _DARK_NOSE, ("tuft", "#e8dcc6"), _HOOF)),
        Coat(skin="#a5622f", belly="#e2d3b8", pattern="dapples", marks="#eddfc5", scale=0.09,
             parts=(("antler", "#8a7150"), _DARK_NOSE, ("tuft", "#efe6d6"), _HOOF)),
        Coat(skin="#6f5846", belly="#b3a18a", parts=(("antler", "#6b563c"), _DARK_NOSE, ("tuft", "#d6c6ad"), _HOOF)),
    ),
    "sheep": (
        Coat(skin="#e5dfd1", legs="#3b332e", parts=_SHEEP_PARTS), Coat(skin="#ddd3c0", legs="#c2ab8c", parts=(("face", "#cdb797"), ("muzzle", "#c2a988"), ("nose", "#8a6a60"), _HOOF)),
        Coat(skin="#cfc5b4", legs="#2e2825", parts=_SHEEP_PARTS),
    ),
    "goat": (
        Coat(skin="#e3dccd", parts=(*_GOAT_PARTS, ("beard", "#efe8da"))),
        Coat(skin="#8a5a35", legs="#211a16", pattern="saddle", marks="#2b1d15", scale=0.3, parts=(*_GOAT_PARTS, ("beard", "#3a281c"))),
        Coat(skin="#55504b", belly="#b9b0a4", parts=(*_GOAT_PARTS, ("beard", "#3a3532"))),
    ),
    "camel": (
        Coat(skin="#b98e5a", belly="#c9a676", parts=(("hump", "#9a7042"), ("nose", "#6e553c"), ("tuft", "#6b4a2c"), ("hoof", "#7a6044"))),
        Coat(skin="#c9a877", parts=(("hump", "#a27c4d"), ("nose", "#7e654a"), ("tuft", "#7c5a38"), ("hoof", "#8a7052"))),
    ),
    "pig": (
        Coat(skin="#e0a898", parts=(("nose", "#c9837a"), ("hoof", "#8a6a5e"), ("ear", "#d7968a"))),
        Coat(skin="#dca493", pattern="patches", marks="#2a2321", scale=0.4, parts=(("nose", "#b9776e"), ("hoof", "#5a4740"))),
        Coat(skin="#4a3b33", parts=(("nose", "#7a5a52"), ("hoof", "#2a2320"))),
    ),
    "dog": (
        Coat(skin="#c89a5c", belly="#e3cfa8", parts=(_DARK_NOSE, ("ear", "#a97a42"))),
        Coat(skin="#e9e4da", pattern="patches", marks="#74431f", scale=0.34, parts=(_DARK_NOSE, ("ear", "#6a3c1c"))),
        Coat(skin="#27211e", legs="#8a5427", belly="#7d4d26", parts=(_DARK_NOSE, ("muzzle", "#7a4a25"), ("ear", "#1e1917"))),
        Coat(skin="#ece7dc", pattern="spots", marks="#171412", scale=0.11, parts=(_DARK_NOSE, ("ear", "#1c1816"))),
    ),
    "fox": (
        Coat(skin="#c2601f", belly="#efe6d8", belly_height=-0.15, legs="#1d1613",
             parts=(_DARK_NOSE, ("sock", "#1a1412"), ("tuft", "#f2ebdf"), ("ear", "#2b1d16"), ("eye", "#a8701d"))),
    ),
    "wolf": (
        Coat(skin="#8c857b", belly="#cfc8bb", pattern="saddle", marks="#3a3632", scale=0.25, legs="#b5a894",
             parts=(_DARK_NOSE, ("ear", "#6b6056"), ("tuft", "#2b2725"), ("eye", "#b98a2a"))),
        Coat(skin="#a39684", belly="#ddd4c4", pattern="saddle", marks="#55483c", scale=0.25,
             parts=(_DARK_NOSE, ("ear", "#8a7a66"), ("tuft", "#3b332d"), ("eye", "#b98a2a"))),
    ),
    "cat": (
        Coat(skin="#8d8478", pattern="tiger", marks="#2b2622", scale=0.14, belly="#c9c1b4", parts=_CAT_PARTS),
        Coat(skin="#c98345", pattern="tiger", marks="#99521f", scale=0.14, belly="#ecdcc2", parts=_CAT_PARTS),
        Coat(skin="#1f1c1b", parts=(("nose", "#1a1514"), ("eye", "#c2b02c"), ("ear", "#2a2423"))),
        Coat(skin="#e0d3bd", pattern="points", marks="#3b2a20", scale=0.16, parts=(("nose", "#3a2a24"), ("eye", "#5c8fc2"), ("ear", "#3b2b22"))),
    ),
    "lion": (
        Coat(skin="#c99d5e", belly="#e6cf9f", parts=(("mane", "#6b3f1d"), ("nose", "#4a2f26"), ("tuft", "#2b1a12"), ("eye", "#a8741f"))),
        Coat(skin="#c39a66", belly="#e0caa0", parts=(("mane", "#3f2818"), ("nose", "#40291f"), ("tuft", "#20140f"), ("eye", "#a8741f"))),
        Coat(skin="#d2ac70", belly="#eadab2", parts=(("mane", "#9a6429"), ("nose", "#54362b"), ("tuft", "#3a2214"), ("eye", "#a8741f"))),
    ),
    "tiger": (
        Coat(skin="#d27a25", belly="#f3ead9", belly_height=-0.2, pattern="tiger", marks="#17110d", scale=0.125,
             parts=(("nose", "#b0746c"), ("muzzle", "#e6bd85"), ("ear", "#2b1d14"), ("eye", "#b59a2c"))),
    ),
    "bear": (
        Coat(skin="#4f3320", legs="#33211a", parts=(_DARK_NOSE, ("muzzle", "#6e4c33"))),
        Coat(skin="#241f1d", parts=(_DARK_NOSE, ("muzzle", "#6b4a30"))),
        Coat(skin="#7c5734", legs="#4a3120", parts=(_DARK_NOSE, ("muzzle", "#8f6a45"))),
        Coat(skin="#e4dcc6", parts=(_DARK_NOSE,)),
    ),
    "rabbit": (
        Coat(skin="#8b7257", belly="#ddd2c0", parts=(("nose", "#8a5f55"), ("tuft", "#efe9df"), ("ear", "#a07e68"))),
        Coat(skin="#e6e0d8", parts=(("nose", "#d3928a"), ("ear", "#d9b0a6"))),
        Coat(skin="#6a6661", belly="#b8b2aa", parts=(("nose", "#6b4f49"), ("tuft", "#dcd6cd"), ("ear", "#857068"))),
    ),
}  # fmt: skip

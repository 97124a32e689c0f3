"""A SerialModel as a URDF, for tests that begin with a file."""

from cosim.arm.serial import SerialModel, roll_pitch_yaw


def urdf_text(model: SerialModel) -> str:
    """Links l0 (the base), l1, ...; the tip is a link fixed to the last one. Rotors and friction are left out."""
    links = ['<link name="l0"/>', '<link name="tip"/>']
    joints = [_joint("tip_joint", "fixed", f"l{model.count}", "tip", model.tip, (0.0, 0.0, 0.0), "")]
    for i, name in enumerate(model.joints):
        bounds = {"lower": model.lower, "upper": model.upper, "effort": model.effort, "velocity": model.speed}
        limit = " ".join(f'{key}="{float(values[i])!r}"' for key, values in bounds.items())
        inner = f'<axis xyz="{_words(model.axis[i])}"/><limit {limit}/>'
        rpy = roll_pitch_yaw(model.rotation[i])
        joints.append(_joint(name, model.kinds[i].value, f"l{i}", f"l{i + 1}", model.origin[i], rpy, inner))
        links.append(_link(model, i))
    return f'<robot name="{model.name}">{"".join(links + joints)}</robot>'


def _words(values) -> str:
    return " ".join(repr(float(v)) for v in values)


def _joint(name: str, kind: str, parent: str, child: str, xyz, rpy, inner: str) -> str:
    origin = f'<origin xyz="{_words(xyz)}" rpy="{_words(rpy)}"/>'
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{origin}{ends}{inner}</joint>'


def _link(model: SerialModel, i: int) -> str:
    moments = " ".join(
        f'i{"xyz"[a]}{"xyz"[b]}="{float(model.inertia[i, a, b])!r}"' for a in range(3) for b in range(a, 3)
    )
    body = f'<origin xyz="{_words(model.centre[i])}"/><mass value="{float(model.mass[i])!r}"/><inertia {moments}/>'
    return f'<link name="l{i + 1}"><inertial>{body}</inertial></link>'

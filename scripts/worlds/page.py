"""The frame that all scenes of the gallery share: settings, looks, floor, rim, workspace, start and goal."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from xml.sax.saxutils import quoteattr

MATERIALS = {
    "wall": 'rgba="0.27 0.33 0.42 1" specular="0.3" shininess="0.4"',
    "wood": 'rgba="0.68 0.50 0.33 1" specular="0.2" shininess="0.3"',
    "oak": 'rgba="0.55 0.39 0.25 1" specular="0.2" shininess="0.3"',
    "steel": 'rgba="0.36 0.47 0.62 1" specular="0.4" shininess="0.5"',
    "carton": 'rgba="0.78 0.62 0.42 1" specular="0.1" shininess="0.2"',
    "fabric": 'rgba="0.35 0.50 0.53 1" specular="0.1" shininess="0.1"',
    "brick": 'rgba="0.66 0.36 0.28 1" specular="0.2" shininess="0.3"',
    "bark": 'rgba="0.45 0.34 0.25 1" specular="0.1" shininess="0.1"',
    "leaves": 'rgba="0.36 0.55 0.34 0.30" specular="0" shininess="0.1"',
    "moss": 'rgba="0.42 0.52 0.38 1" specular="0.2" shininess="0.3"',
    "water": 'rgba="0.33 0.57 0.74 1" specular="0.6" shininess="0.8"',
    "plank": 'rgba="0.72 0.58 0.40 1" specular="0.1" shininess="0.2"',
    "rim": 'rgba="0.62 0.66 0.70 1"',
}
PUCK = {
    "noise": 0.1,
    "period": 0.02,
    "dt": 0.1,
    "samples": 200,
    "limit": 0.6,
    "vertices": 1000,
    "classes": 8,
    "max_time": 60,
}
RIM = 0.02  # half width of the border that is drawn [m]


@dataclass(frozen=True, kw_only=True)
class Page:
    """One scene: what it is about, how large it is, what stands in it."""

    name: str
    about: str  # one sentence, which `pirrht scenes` shows
    why: str  # what the file's comment adds
    size: tuple[float, float]  # of the workspace, whose corner is the origin [m]
    start: tuple[float, float]
    goal: tuple[float, float, float]  # x, y, radius
    elements: Sequence[str]  # of the worldbody
    settings: Mapping[str, float] = field(default_factory=dict)  # beside `PUCK`
    assets: Sequence[str] = ()  # meshes

    def text(self) -> str:
        """The MJCF."""
        (width, depth), (x, y), (gx, gy, radius) = self.size, self.start, self.goal
        body = "\n".join(f"    {element}" for element in self.elements)
        used = [name for name in MATERIALS if name == "rim" or f'material="{name}"' in body]
        materials = "\n".join(f'    <material name="{name}" {MATERIALS[name]}/>' for name in used)
        meshes = "".join(f"    {asset}\n" for asset in self.assets)
        numbers = "\n".join(
            f'    <numeric name="pirrht_{name}" data="{value:g}"/>' for name, value in {**PUCK, **self.settings}.items()
        )
        high = 1.26 * max(depth, 0.8 * width)
        return f"""<!-- {self.why}

     Made by scripts/make_scenes.py. -->
<mujoco model={quoteattr(self.name)}>
  <option timestep="0.002" integrator="Euler"/>
  <custom>
    <text name="pirrht_about" data={quoteattr(self.about)}/>
    <text name="pirrht_robot" data="puck"/>
{numbers}
  </custom>
  <visual>
    <global offwidth="1280" offheight="960"/>
    <quality shadowsize="4096"/>
    <headlight ambient="0.42 0.42 0.42" diffuse="0.22 0.22 0.22" specular="0 0 0"/>
  </visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="0.86 0.90 0.94" rgb2="0.55 0.63 0.72"
             width="256" height="256"/>
    <texture name="tiles" type="2d" builtin="checker" rgb1="0.86 0.87 0.88" rgb2="0.82 0.835 0.85"
             width="512" height="512"/>
    <material name="floor" texture="tiles" texrepeat="1 1" texuniform="true" reflectance="0.03"/>
{materials}
{meshes}  </asset>
  <default>
    <default class="rim">
      <geom type="box" material="rim" contype="0" conaffinity="0"/>
    </default>
    <default class="seen">
      <geom contype="0" conaffinity="0"/>
    </default>
  </default>
  <worldbody>
    <light name="sun" directional="true" pos="1 -2 8" dir="0.25 0.45 -1" diffuse="0.38 0.38 0.36"
           specular="0.1 0.1 0.1" castshadow="true"/>
    <camera name="top" pos="{width / 2:g} {depth / 2:g} {high:g}" xyaxes="1 0 0 0 1 0" fovy="42"/>
    <geom name="floor" type="plane" pos="{width / 2:g} {depth / 2:g} 0" size="{width / 2:g} {depth / 2:g} 0.1"
          material="floor"/>
{body}
    <geom class="rim" pos="{width / 2:g} {-RIM:g} 0.02" size="{width / 2 + 2 * RIM:g} 0.02 0.02"/>
    <geom class="rim" pos="{width / 2:g} {depth + RIM:g} 0.02" size="{width / 2 + 2 * RIM:g} 0.02 0.02"/>
    <geom class="rim" pos="{-RIM:g} {depth / 2:g} 0.02" size="0.02 {depth / 2:g} 0.02"/>
    <geom class="rim" pos="{width + RIM:g} {depth / 2:g} 0.02" size="0.02 {depth / 2:g} 0.02"/>
    <site name="workspace" type="box" pos="{width / 2:g} {depth / 2:g} 0.5" size="{width / 2:g} {depth / 2:g} 0.5"
          group="4" rgba="0.4 0.5 0.6 0.05"/>
    <site name="start" type="cylinder" pos="{x:g} {y:g} 0.002" size="0.06 0.002" rgba="0.20 0.45 0.75 0.8"/>
    <site name="goal" type="cylinder" pos="{gx:g} {gy:g} 0.003" size="{radius:g} 0.003" rgba="0.25 0.65 0.35 0.7"/>
  </worldbody>
</mujoco>
"""


def box(
    name: str,
    x: tuple[float, float],
    y: tuple[float, float],
    high: float = 0.5,
    material: str = "wall",
    low: float = 0.0,
) -> str:
    """A box between two x, two y and two heights [m]."""
    place = f"{(x[0] + x[1]) / 2:.6g} {(y[0] + y[1]) / 2:.6g} {(low + high) / 2:.6g}"
    half = f"{(x[1] - x[0]) / 2:.6g} {(y[1] - y[0]) / 2:.6g} {(high - low) / 2:.6g}"
    return f'<geom name="{name}" type="box" pos="{place}" size="{half}" material="{material}"/>'


def seen(kind: str, place: str, size: str, material: str) -> str:
    """Something that is only looked at."""
    return f'<geom class="seen" type="{kind}" pos="{place}" size="{size}" material="{material}"/>'


def drum(name: str, x: float, y: float, radius: float, high: float = 0.5, material: str = "brick") -> str:
    """An upright cylinder [m]."""
    place, half = f"{x:.6g} {y:.6g} {high / 2:.6g}", f"{radius:.6g} {high / 2:.6g}"
    return f'<geom name="{name}" type="cylinder" pos="{place}" size="{half}" material="{material}"/>'

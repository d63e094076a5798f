"""Write an MJCF scene, plan in it and run it in MuJoCo with a Rerun recording, as `pirrht run pond.xml` does."""

import sys
import tempfile
from pathlib import Path

from sim import cli

POND = """<mujoco model="pond">
  <custom><numeric name="pirrht_noise" data="0.15"/></custom>
  <worldbody>
    <geom name="lawn" type="plane" pos="3 2 0" size="3 2 0.1" rgba="0.6 0.75 0.5 1"/>
    <geom name="pond" type="cylinder" pos="2.2 2.1 0.05" size="0.6 0.05" rgba="0.3 0.5 0.7 1"/>
    <geom name="hedge" type="box" pos="4 2.85 0.3" size="0.15 0.75 0.3" rgba="0.3 0.5 0.3 1"/>
    <site name="start" pos="0.5 2 0"/>
    <site name="goal" type="cylinder" pos="5.4 2 0" size="0.25 0.01"/>
    <site name="workspace" type="box" pos="3 2 0.5" size="3 2 0.5"/>
  </worldbody>
</mujoco>
"""
folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
(folder / "pond.xml").write_text(POND)
few = ["--vertices", "300", "--samples", "100", "--period", "0.05"]
status = cli.main(["run", str(folder / "pond.xml"), *few, "--record", str(folder / "pond.rrd")])
print(f"exit status {status}; open the recording with: rerun {folder / 'pond.rrd'}")

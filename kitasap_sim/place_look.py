"""What all places that a program makes have in common: physics, picture, tiles and light, as MJCF."""

OPTION_XML = """\
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.002" integrator="implicitfast" cone="elliptic" impratio="10" jacobian="dense"/>
"""
VISUAL_XML = """\
  <visual>
    <global offwidth="1280" offheight="960" fovy="45"/>
    <headlight ambient=".42 .42 .42" diffuse=".18 .18 .18" specular="0 0 0"/>
  </visual>
"""
ASSETS_XML = """\
  <asset>
    <texture name="sky" type="skybox" builtin="flat" rgb1=".93 .95 .97" rgb2=".93 .95 .97" width="32" height="32"/>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".70 .72 .73" rgb2=".65 .67 .69" width="256" height="256"/>
    <material name="floor" texture="tiles" texrepeat="2 2" texuniform="true" specular=".1" shininess=".1"/>
  </asset>
"""
LIGHTS_XML = """\
    <light name="sun" type="directional" dir=".22 .28 -1" diffuse=".40 .39 .36" specular=".1 .1 .1"/>
    <light name="fill" type="directional" dir="-.5 -.6 -.6" diffuse=".22 .23 .25" specular="0 0 0" castshadow="false"/>
"""

"""The floor plan that the help shows; the tests make a place of it."""

EXAMPLE = """\
# two rooms, a door between them, and what stands about; metres and degrees
height: 0.8                      # of walls and things, unless they say
thickness: 0.1                   # of walls; their lines are their middles
walls:
  - line: [[0, 0], [6, 0], [6, 4], [0, 4]]
    closed: yes                  # back to the first point
  - line: [[3.5, 0], [3.5, 4]]
    doors: [[1.5, 2.5]]          # gaps: from, to along the line
    thickness: 0.15
boxes:                           # at: the middle
  - {name: cupboard, at: [0.5, 3.6], size: [0.8, 0.6], height: 1.2}
  - {name: table, at: [5, 3], size: [1.2, 0.6], height: 0.7, turned: 30}
cylinders:
  - {name: pillar, at: [1.8, 2.4], radius: 0.15}
start: {at: [1, 1], heading: 90} # optional; else the roomiest spot
"""

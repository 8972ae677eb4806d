"""Small USD files for tests."""

METRES = 'upAxis = "Y"\n    metersPerUnit = 1'
CENTIMETRES_Z_UP = 'upAxis = "Z"\n    metersPerUnit = 0.01'
SECONDS = "startTimeCode = 10\n    endTimeCode = 34\n    timeCodesPerSecond = 24"
SQUARE = """
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)]
    uniform token subdivisionScheme = "none"
"""


def usda(tmp_path, body, meta=METRES, name="scene.usda"):
    """Write a text file of that header and body; USD wants a line's end before each brace that closes."""
    path, body = tmp_path / name, body.replace("}", "\n}")
    path.write_text(f"#usda 1.0\n(\n    {meta}\n)\n{body}")
    return path


def mesh(extra="", name="square", shape=SQUARE):
    """Return a mesh as text, with more in it."""
    return f'def Mesh "{name}"\n{{{shape}{extra}\n}}\n'


def placed(*operations):
    """Return operations such as ``double3 xformOp:translate = (1, 2, 3)`` as text, with their order."""
    names = [operation.split()[1].removesuffix(".timeSamples") for operation in operations]
    listed = ", ".join(f'"{name}"' for name in names)
    return "\n".join([*operations, f"uniform token[] xformOpOrder = [{listed}]\n"])


def points_at(world, instance, time_s):
    mesh = world.meshes[instance.mesh]
    vertices = mesh.vertices if mesh.deformation is None else mesh.deformation.vertices_at(time_s)[0]
    pose = instance.motion.pose(time_s)
    return vertices @ pose[:3, :3].T + pose[:3, 3]


CAMERA = 'def Camera "eye"\n{\n' + placed("double3 xformOp:translate = (0, 0, 9)") + "}\n"
VANISHING = """def PointInstancer "twice" { rel prototypes = [</square>]\n int[] protoIndices = [0, 0]
point3f[] positions.timeSamples = { 10: [(0, 0, 0), (1, 1, 1)], 34: [(1, 2, 3)] } }"""
TIMED = f"{METRES}\n    {SECONDS}"
MOVING_COPIES = VANISHING.replace("[(1, 2, 3)]", "[(1, 2, 3), (3, 2, 1)]")

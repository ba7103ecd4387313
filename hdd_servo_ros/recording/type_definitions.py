"""
Definitions and hashes of the recorded message types, identical to those of `rosbags` for Jazzy.

They are copied here because loading the types of `rosbags` takes as long as recording 10,000 ticks. A test compares
both.
"""

_RULE = '=' * 80

_TEXTS = {
    'builtin_interfaces/Time': 'int32 sec\nuint32 nanosec\n',
    'geometry_msgs/Accel': 'geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n',
    'geometry_msgs/AccelStamped': 'std_msgs/Header header\ngeometry_msgs/Accel accel\n',
    'geometry_msgs/Vector3': 'float64 x\nfloat64 y\nfloat64 z\n',
    'geometry_msgs/Vector3Stamped': 'std_msgs/Header header\ngeometry_msgs/Vector3 vector\n',
    'rcl_interfaces/Parameter': 'string name\nrcl_interfaces/ParameterValue value\n',
    'rcl_interfaces/ParameterEvent': """\
builtin_interfaces/Time stamp
string node
rcl_interfaces/Parameter[] new_parameters
rcl_interfaces/Parameter[] changed_parameters
rcl_interfaces/Parameter[] deleted_parameters
""",
    'rcl_interfaces/ParameterValue': """\
uint8 type
bool bool_value
int64 integer_value
float64 double_value
string string_value
byte[] byte_array_value
bool[] bool_array_value
int64[] integer_array_value
float64[] double_array_value
string[] string_array_value
""",
    'rosgraph_msgs/Clock': 'builtin_interfaces/Time clock\n',
    'std_msgs/Float64MultiArray': 'std_msgs/MultiArrayLayout layout\nfloat64[] data\n',
    'std_msgs/Header': 'builtin_interfaces/Time stamp\nstring frame_id\n',
    'std_msgs/MultiArrayDimension': 'string label\nuint32 size\nuint32 stride\n',
    'std_msgs/MultiArrayLayout': 'std_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n',
}
"""Definition of each type without those of its members, by its name in definitions."""

_HASHES = {
    'geometry_msgs/AccelStamped': 'ef1df9eabae0a708cc049a061ebcddc4e2a5f745730100ba680e086a9698b165',
    'geometry_msgs/Vector3Stamped': 'd4829622288cbb443886e7ea94ea5671a3b1be6bab4ad04224432a65f7d7887a',
    'rcl_interfaces/ParameterEvent': '043e627780fcad87a22d225bc2a037361dba713fca6a6b9f4b869a5aa0393204',
    'rosgraph_msgs/Clock': '692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564',
    'std_msgs/Float64MultiArray': '1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f',
    'std_msgs/Header': 'f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01',
}

KNOWN = tuple(name.replace('/', '/msg/') for name in _HASHES)
"""Types defined in this module."""


def known_definition(type_name: str) -> tuple[str, str]:
    """
    Return the definition of a known type, including those of its member types, and its hash.

    Parameters
    ----------
    type_name
        One of :data:`KNOWN`.

    Raises
    ------
    KeyError
        If the type is unknown.
    """
    name = type_name.replace('/msg/', '/')
    found: dict[str, str] = {}
    _collect(name, found)
    own = found.pop(name)
    others = (f'{_RULE}\nMSG: {part}\n{text}' for part, text in found.items())
    return ''.join([own, *others]), f'RIHS01_{_HASHES[name]}'


def _collect(name: str, found: dict[str, str]) -> None:
    """Collect a type and, in the order of its fields, its member types."""
    if name not in found:
        found[name] = _TEXTS[name]
        for line in _TEXTS[name].splitlines():
            kind = line.split()[0].removesuffix('[]')
            if kind in _TEXTS:
                _collect(kind, found)

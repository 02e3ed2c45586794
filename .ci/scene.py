"""What scene and state must be, for those who find them in a recording or on a live connection."""

import copy

import jsonschema
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.json_format import ParseDict

SCENE, STATE = "/equipoise/scene", "/equipoise/state_json"
IDS = {"figure", "suggested pose", "support polygon", "centre of pressure, measured",
       "centre of pressure, estimated", "advice", "words"}


def validator(schema):
    """Of a schema that is one itself."""
    kind = jsonschema.validators.validator_for(schema, default=jsonschema.Draft202012Validator)
    kind.check_schema(schema)
    return kind(schema)


def must_fit(known, message, topic):
    misfit = next(known.iter_errors(message), None)
    assert misfit is None, f"{topic}: {misfit.message} at {list(misfit.absolute_path)}"


def as_protobuf(message):
    """The same scene as Foxglove's own message: it refuses unknown fields, and values of another type."""
    scene = copy.deepcopy(message)
    for thing in scene["deletions"] + scene["entities"]:
        for key in ("timestamp", "lifetime"):
            if key in thing:
                time = thing[key]
                stamp = f'{time["sec"]}.{time["nsec"]:09d}s'
                thing[key] = stamp if key == "lifetime" else "1970-01-01T00:00:00Z"
    return ParseDict(scene, SceneUpdate())


def check_scene(message):
    """Whole, in one frame, and gone by itself when nothing follows; gives the ids of what is drawn."""
    scene = as_protobuf(message)
    drawn = {entity.id for entity in scene.entities}
    assert drawn | {deletion.id for deletion in scene.deletions} == IDS, "neither drawn nor taken away"
    for entity in scene.entities:
        assert entity.frame_id == "station", entity.frame_id
        assert 0 < entity.lifetime.seconds <= 5, f"{entity.id} would stay"
        if entity.id == "figure":
            assert len(entity.spheres) == 23 and len(entity.lines[0].points) == 44
    return drawn


def check_state(message):
    """Values and reasons agree."""
    if message["valid"]:
        assert "joints" not in message, f'torques are published in spite of {message["valid"]}'

"""The JSON API as an OpenAPI document, from the types that requests are decoded with."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import msgspec

from .requests import HogRequest, InvertRequest, PoseRequest

REQUESTS = (HogRequest, InvertRequest, PoseRequest)
ERROR = {"type": "object", "required": ["error"], "properties": {"error": {"type": "string"}}}
BYTES = {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}


def document() -> dict[str, Any]:
    """The document, version 3.1."""
    _, components = msgspec.json.schema_components(REQUESTS, ref_template="#/components/schemas/{name}")
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "nablahog",
            "version": version("nablahog"),
            "description": "HOG descriptors of photographs, images of descriptors, and poses of objects. Pictures in "
            "JSON are base64 of PNG. Poses that are dragged go over a WebSocket, /api/fit.",
        },
        "components": {"schemas": {**components, "Error": ERROR}},
        "paths": {
            "/api/about": {"get": _operation("What there is: presets with their parameters, samples, limits.")},
            "/api/photos": {"post": _upload("Keeps a photograph; its id stands for it.", "name")},
            "/api/photos/{id}": {
                "get": _operation("The photograph, shrunk.", kind="image/png", path=["id"], query=["size"])
            },
            "/api/descriptors": {
                "post": _upload(
                    "Keeps the descriptor, or a detector's templates, in a .npy, .npz or .mat file.",
                    *("name", "as", "preset", "settings", "image_size", "key"),
                )
            },
            "/api/meshes": {
                "post": _upload("Keeps the mesh in an OFF, OBJ, PLY, STL or GLB file.", "name", "up", "front")
            },
            "/api/hog": {"post": _json("The descriptor of a photograph: shape, glyphs, an id.", HogRequest)},
            "/api/hog/{id}/cell": {
                "get": _operation("What it says of a cell, by name.", path=["id"], query=["row", "col"])
            },
            "/api/hog/{id}/file": {
                "get": _operation("As `nablahog hog` writes it.", kind="application/octet-stream", path=["id"])
            },
            "/api/invert": {
                "post": _json(
                    "A pre-image while it is searched: the events queued, start, frame, done or error.",
                    InvertRequest,
                    kind="text/event-stream",
                )
            },
            "/api/pose": {"post": _json("The pose of the object in a box.", PoseRequest)},
        },
    }


def _operation(
    summary: str, *, kind: str = "application/json", path: list[str] | None = None, query: list[str] | None = None
) -> dict[str, Any]:
    parameters = [
        *({"name": name, "in": "path", "required": True, "schema": {"type": "string"}} for name in path or []),
        *({"name": name, "in": "query", "schema": {"type": "string"}} for name in query or []),
    ]
    return {
        "summary": summary,
        "parameters": parameters,
        "responses": {
            "200": {"description": "done", "content": {kind: {}}},
            "default": {
                "description": "one sentence that says what was expected and what came",
                "content": {"application/json": {"schema": {"$ref": "#/components/schemas/Error"}}},
            },
        },
    }


def _upload(summary: str, *query: str) -> dict[str, Any]:
    return {**_operation(summary, query=list(query)), "requestBody": {"required": True, "content": BYTES}}


def _json(summary: str, request: type[msgspec.Struct], kind: str = "application/json") -> dict[str, Any]:
    content = {"application/json": {"schema": {"$ref": f"#/components/schemas/{request.__name__}"}}}
    return {**_operation(summary, kind=kind), "requestBody": {"required": True, "content": content}}

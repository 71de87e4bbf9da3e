"""Car bodies: local frame x forward, y left, standing on z = 0, centred."""

from __future__ import annotations

from dataclasses import dataclass

from depthprint.simulation.meshes import Triangles, box, hexahedron, merge

__all__ = ["CAR_MODELS", "CarModel", "car_body"]


@dataclass(frozen=True)
class CarModel:
    """Outline of a body: metres, and shares of the length measured from the front (0) to the rear (1).

    cabin_low, cabin_high: where the cabin begins and ends at the belt line and at the roof.
    """

    name: str
    length: float
    width: float
    height: float
    belt: float
    cabin_low: tuple[float, float]
    cabin_high: tuple[float, float]


CAR_MODELS: tuple[CarModel, ...] = (
    CarModel("small", 3.5, 1.62, 1.49, 0.92, (0.22, 1.0), (0.40, 0.93)),
    CarModel("hatchback", 4.2, 1.76, 1.47, 0.92, (0.26, 0.98), (0.45, 0.88)),
    CarModel("saloon", 4.7, 1.82, 1.44, 0.95, (0.28, 0.86), (0.44, 0.70)),
    CarModel("estate", 4.7, 1.82, 1.48, 0.95, (0.28, 0.99), (0.44, 0.93)),
    CarModel("suv", 4.6, 1.88, 1.72, 1.10, (0.25, 0.99), (0.38, 0.92)),
    CarModel("minivan", 4.6, 1.85, 1.80, 1.05, (0.14, 0.99), (0.32, 0.95)),
    CarModel("van", 5.4, 1.98, 2.25, 1.15, (0.09, 1.0), (0.24, 0.99)),
)


def car_body(model: CarModel, scale: float = 1.0) -> Triangles:
    """Triangles of a car: a lower body, a cabin that narrows to the roof, and four wheels; ``scale`` sizes all."""
    length, width = model.length * scale, model.width * scale
    height, belt, clearance = model.height * scale, model.belt * scale, 0.22
    half, side = length / 2, width / 2

    def along(share: float) -> float:
        return half - share * length

    shoulder, roof = side * 0.97, side * 0.78
    body = box(-half, half, -side, side, clearance, 0.72 * belt)
    deck = hexahedron(
        (-half, half, -side, side), (-half * 0.97, half * 0.9, -shoulder, shoulder), 0.72 * belt, belt
    )
    cabin = hexahedron(
        (along(model.cabin_low[1]), along(model.cabin_low[0]), -shoulder, shoulder),
        (along(model.cabin_high[1]), along(model.cabin_high[0]), -roof, roof),
        belt,
        height,
    )
    wheels = [
        box(x - 0.3, x + 0.3, y - 0.1, y + 0.1, 0.0, 0.6)
        for x in (0.3 * length, -0.3 * length)
        for y in (side - 0.11, 0.11 - side)
    ]
    return merge([body, deck, cabin, *wheels])

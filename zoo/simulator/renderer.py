"""A renderer of a track's camera frames with Panda3D: in software without a display, or OpenGL.

The software renderer (`p3tinydisplay`) opens no display but needs libX11 (Debian: libx11-6). Its
frames are identical on every machine and in every run. A few large pieces are faster than many
small ones. Near materials are drawn first, because pixels hidden behind them are skipped.
"""

import pickle
from dataclasses import fields
from functools import lru_cache
from itertools import zip_longest
from threading import Lock

import cv2
import numpy as np

from zoo.base.errors import InputError
from zoo.base.rig import UDACITY, Rig
from zoo.base.run_command import held_interrupt
from zoo.simulator.scenery.edges import bridge_meshes, edge_meshes
from zoo.simulator.scenery.frame_effects import Air
from zoo.simulator.scenery.ground import Ground
from zoo.simulator.scenery.light import Shadows, lit_colours, sky_mesh
from zoo.simulator.scenery.mesh import Mesh, cut, join_materials, outward
from zoo.simulator.scenery.plants import boulder_meshes, place_standing, standing_mesh
from zoo.simulator.scenery.road import ALONG_M, road_levels, road_meshes
from zoo.simulator.scenery.roadside import road_signs, roadside_meshes
from zoo.simulator.scenery.textures import halvings, make_textures
from zoo.simulator.track import Track
from zoo.simulator.udacity_car import FOV_DEG, NEAR_M, camera_matrix
from zoo.simulator.weather import CLEAR, Weather, lit_by
from zoo.simulator.world_settings import Quality, WorldSettings

with held_interrupt():  # Panda3D's C++ ends the process if Ctrl-C arrives while it is imported
    from panda3d import core

SETTINGS = "audio-library-name null\nnotify-level fatal\ntextures-power-2 down\n"
# Collected states would wait for Panda3D's task manager, which does not run here: 4 kB a frame, and
# the textures of a closed renderer.
SETTINGS += "garbage-collect-states false"
RGB_FROM = {3: cv2.COLOR_BGR2RGB, 4: cv2.COLOR_BGRA2RGB}  # by the number of a frame's channels
FAR_M = 1500.0
CELL_M = 90.0
FAST_CELL_M, FAST_ALONG_M = 200.0, 4.0  # of quality `fast`: cells; rows of faces below verges
ORDER = (
    *("asphalt", "worn", "plain", "cobbles", "stripes", "hazard", "concrete"),
    *("leaves", "ground", "rock", "bare", "plants", "sky"),
)
POINTS = core.GeomVertexFormat.getV3c4t2()
POINT = np.dtype([("point", "<f4", 3), ("colour", "u1", 4), ("uv", "<f4", 2)])


Piece = tuple[Mesh, core.GeomVertexData]  # a mesh and the renderer's copy of its points
Opened = tuple[core.GraphicsEngine, core.GraphicsOutput, str]  # with the renderer's name
# Buffers of closed renderers. Panda3D 1.10 frees no buffer, which is 0.4 MB for each drive.
IDLE: list[Opened] = []
DRAWING = Lock()  # the software renderer draws wrong frames in two threads at once


class Renderer:
    """A renderer of one track; `name` is `software` or `opengl`.

    Args:
        track: track to draw.
        renderer: auto, software or opengl.
        quality: full; fast (less detail far away); or simple (fewer plants, no shadows).
        rig: cameras, all of the first one's size and field of view. Only Udacity's car has a
            bonnet in its frames.

    Raises:
        InputError: the renderer does not open on this machine, or the quality is unknown.
    """

    def __init__(
        self, track: Track, renderer: str = "auto", quality: Quality = "full", rig: Rig = UDACITY
    ) -> None:
        WorldSettings(quality=quality).check()
        self.track, self.rig = track, rig
        self.first = next(iter(rig.cameras.values()))
        self.size = self.first.size
        with DRAWING:
            opened = _take_idle(renderer, *self.size) or open_buffer(renderer, *self.size)
        self.engine, self.buffer, self.name = opened
        self.texture = core.Texture()
        self.buffer.addRenderTexture(self.texture, core.GraphicsOutput.RTMCopyRam)
        self.root = core.NodePath("world")
        self.lens = camera_lens()
        self.camera = self.root.attachNewNode(core.Camera("camera", self.lens))
        self.buffer.makeDisplayRegion().setCamera(self.camera)
        self.textures = {name: core.Texture(name) for name in ORDER}
        meshes, self.shadows = landscape(track, quality)
        self.fast = quality == "fast"
        self.places: dict[int, core.NodePath] = {}
        dome, self.sky = self._attach(sky_mesh(self.fast, track.surroundings.sky))
        self.sky.setTextureOff(1)
        self.pieces = [*(self._attach(mesh)[0] for mesh in meshes), dome]
        self.seed_drawn: int | None = None
        self.set_weather(CLEAR, 0)

    def set_weather(self, weather: Weather, seed: int) -> None:
        """Light the world for a weather; `seed` is for rain and sensor noise."""
        weather = lit_by(self.track.surroundings, weather)
        if weather.texture_seed != self.seed_drawn:
            for name, pixels in make_textures(weather.texture_seed).items():
                _fill_texture(self.textures[name], pixels)
            self.seed_drawn = weather.texture_seed
        shadows = self.shadows(weather) if self.shadows and weather.shadows else []
        for piece, shade in zip_longest(self.pieces, shadows):
            _set_colours(piece, lit_colours(piece[0], weather, shade))
        widened_deg = self.first.vertical_fov_deg + weather.camera.fov_deg
        self.fov_deg = float(np.clip(widened_deg, *FOV_DEG))
        set_view(self.lens, self.size[0] / self.size[1], self.fov_deg)
        self.weather, self.air = weather, Air(weather, seed, self.rig)

    def frame(
        self, pose: tuple[float, float, float, float, float], camera: str, tick: int
    ) -> np.ndarray:
        """Return a camera's frame: uint8 [H, W, 3], RGB; 160 x 320 from Udacity's rig.

        Args:
            pose: x, y, z of the car in metres, heading and upward pitch in radians.
            camera: name of a camera of the rig.
            tick: number of the frame, which seeds its rain and noise.
        """
        self.place_camera(self.camera, pose, camera)
        with DRAWING:
            self.engine.renderFrame()
        pixels = np.frombuffer(self.texture.getRamImage(), np.uint8)  # blue first, lowest row first
        pixels = pixels.reshape(*self.size[::-1], self.texture.getNumComponents())
        return self.air(cv2.flip(cv2.cvtColor(pixels, RGB_FROM[pixels.shape[2]]), 0), camera, tick)

    def place_camera(
        self, node: core.NodePath, pose: tuple[float, float, float, float, float], camera: str
    ) -> None:
        """Move a Panda3D camera to the car's camera, and the sky around it."""
        x, y, z, heading, pitch = pose
        offset, mount = self.weather.camera, self.rig.cameras[camera]
        shift = np.array([mount.right_m + offset.right_m, mount.up_m + offset.up_m, mount.ahead_m])
        car = _car_axes(heading, pitch)
        looks = car @ camera_matrix(
            mount.pitch_down_deg - offset.pitch_deg,
            mount.yaw_right_deg + offset.yaw_deg,
            mount.roll_deg + offset.roll_deg,
        )
        at = (np.array([x, y, z]) + car @ shift).tolist()
        right, up, ahead = looks.T.tolist()
        node.setMat(core.LMatrix4f(*right, 0, *ahead, 0, *up, 0, *at, 1))
        self.sky.setPos(*at)

    def close(self) -> None:
        """Leave the buffer to the next renderer."""
        if self.root.isEmpty():  # closed already
            return
        self.root.removeNode()
        self.buffer.removeAllDisplayRegions()
        self.buffer.clearRenderTextures()
        IDLE.append((self.engine, self.buffer, self.name))

    def _attach(self, mesh: Mesh) -> tuple[Piece, core.NodePath]:
        data = core.GeomVertexData(mesh.material, POINTS, core.Geom.UHDynamic)
        data.uncleanSetNumRows(len(mesh.points))
        triangles = core.GeomTriangles(core.Geom.UHStatic)
        triangles.setIndexType(core.Geom.NTUint32)
        indices = triangles.modifyVertices()
        indices.setNumRows(mesh.triangles.size)
        indices.modifyHandle().copyDataFrom(mesh.triangles.astype("<u4").tobytes())
        piece = mesh, data
        _set_colours(piece, np.full((len(mesh.points), 3), 255, np.uint8))
        geom = core.Geom(data)
        geom.addPrimitive(triangles)
        node = core.GeomNode(mesh.material)
        node.addGeom(geom)
        path = self._place(mesh).attachNewNode(node)
        path.setTexture(self.textures[mesh.material])
        path.setBin("fixed", ORDER.index(mesh.material))
        path.setTwoSided(not self.fast or mesh.material in ("plants", "sky"))
        if self.fast and mesh.material in ("plain", "bare"):
            path.setTextureOff(1)  # theirs would be white
        if mesh.material == "plants":
            path.setTransparency(core.TransparencyAttrib.MBinary)
        return piece, path

    def _place(self, mesh: Mesh) -> core.NodePath:
        """Return the node of a mesh: the root, or one that draws it by its place's distance."""
        if mesh.group is None:
            return self.root
        if mesh.group not in self.places:
            node = core.LODNode("place")
            node.setCenter(core.Point3(*mesh.points.mean(0)))
            self.places[mesh.group] = self.root.attachNewNode(node)
        near, far = mesh.seen_m
        self.places[mesh.group].node().addSwitch(min(far, FAR_M), near)
        return self.places[mesh.group]


# Meshes in cells of `CELL_M`, those of the road first, and shadows on the road's; None without.
Landscape = tuple[tuple[Mesh, ...], Shadows | None]


def landscape(track: Track, quality: str) -> Landscape:
    """Return the landscape of a track; for `quality` see `Renderer`."""
    # A process opens a world for each drive: a further one on a track opens in 0.07 s instead of
    # 0.35 s. The key is the contents, because each world of a track has a `Track` of its own.
    return _landscape(
        pickle.dumps([getattr(track, field.name) for field in fields(track)]), quality
    )


@lru_cache(maxsize=2)
def _landscape(contents: bytes, quality: str) -> Landscape:
    track = Track(*pickle.loads(contents))
    fast = quality == "fast"
    ground = Ground(track, coarse=fast)
    standing = [*place_standing(track, ground, quality), *road_signs(track)]
    built = [] if fast else road_meshes(track)
    built += edge_meshes(track, ground, FAST_ALONG_M if fast else ALONG_M)
    built += [*bridge_meshes(track, ground), *roadside_meshes(track, ground)]
    cell = FAST_CELL_M if fast else CELL_M
    road = [part for mesh in join_materials(built) for part in cut(mesh, cell)]
    road += road_levels(track) if fast else []
    points = [mesh.points for mesh in road]
    shadows = None if quality == "simple" else Shadows(track, standing, points)
    around = [*ground.meshes(), *([standing_mesh(standing, ground)] if standing else [])]
    around += join_materials(boulder_meshes(track, ground, quality))
    parts = (*road, *(part for mesh in around for part in cut(mesh, cell)))
    parts = tuple(map(outward, parts)) if fast else parts
    for mesh in parts:
        for array in (*mesh.columns, mesh.triangles):
            array.flags.writeable = False  # worlds share them
    return parts, shadows


def _take_idle(renderer: str, width: int, height: int) -> Opened | None:
    """Return an open buffer of a closed renderer; None without a fitting one."""
    wanted = width, height, "software" if renderer == "auto" else renderer
    for opened in list(IDLE):
        _, buffer, name = opened
        if (buffer.getXSize(), buffer.getYSize(), name) == wanted:
            IDLE.remove(opened)
            return opened
    return None


def open_buffer(renderer: str, width: int, height: int) -> Opened:
    """Open an offscreen buffer; return engine, buffer and the renderer's name.

    `auto` is `software`, whose frames are identical everywhere, or `opengl` where software does not
    open.

    Raises:
        InputError: the renderer is unknown or does not open on this machine.
    """
    if renderer not in ("auto", "software", "opengl"):
        raise InputError(f"renderer={renderer}: must be auto, software or opengl")
    core.loadPrcFileData("", SETTINGS)
    pipes = core.GraphicsPipeSelection.getGlobalPtr()
    for name in ("software", "opengl") if renderer == "auto" else (renderer,):
        # By its type, because the module's default pipe connects to a display if there is one.
        if name == "software":
            pipe = pipes.makePipe("TinyOffscreenGraphicsPipe", "p3tinydisplay")
        else:
            pipe = pipes.makeModulePipe("p3headlessgl")
        if pipe is not None:
            engine, buffer = _make_buffer(pipe, width, height)
            if buffer is not None:
                return engine, buffer, name
    raise InputError(
        f"renderer={renderer}: does not open on this machine; the software renderer needs libX11 "
        "(Debian and Ubuntu: apt install libx11-6), OpenGL needs a driver with EGL"
    )


def _make_buffer(
    pipe: core.GraphicsPipe, width: int, height: int
) -> tuple[core.GraphicsEngine, core.GraphicsOutput | None]:
    """Return an engine, and its buffer of a size in pixels; None if it does not open."""
    wanted = core.FrameBufferProperties()
    wanted.setRgbaBits(8, 8, 8, 0)
    wanted.setDepthBits(24)
    wanted.setBackBuffers(0)
    asked = core.WindowProperties.size(width, height)
    engine, flags = core.GraphicsEngine(pipe), core.GraphicsPipe.BFRefuseWindow
    return engine, engine.makeOutput(pipe, "renderer", 0, wanted, asked, flags)


def camera_lens() -> core.PerspectiveLens:
    """Return the lens of a camera, without its field of view."""
    lens = core.PerspectiveLens()
    lens.setNearFar(NEAR_M, FAR_M)
    return lens


def set_view(lens: core.PerspectiveLens, aspect: float, vertical_fov_deg: float) -> None:
    """Set the ratio of a view's width and height, and the angle from its top to its bottom."""
    wide = 2 * np.degrees(np.arctan(np.tan(np.radians(vertical_fov_deg / 2)) * aspect))
    lens.setFov(float(wide), vertical_fov_deg)


def _car_axes(heading: float, pitch: float) -> np.ndarray:
    """Return float64 [3, 3] with the car's right, up and ahead in the world as columns."""
    cos, sin = float(np.cos(heading)), float(np.sin(heading))
    flat, up = float(np.cos(pitch)), float(np.sin(pitch))
    east, north = flat * cos, flat * sin
    # Right x ahead by hand, because np.cross is ten times slower for one pair.
    above = (-cos * up, -sin * up, sin * north + cos * east)
    return np.array([(sin, -cos, 0.0), above, (east, north, up)]).T


def _set_colours(piece: Piece, colours: np.ndarray) -> None:
    mesh, data = piece
    points = np.empty(len(mesh.points), POINT)
    points["point"], points["uv"] = mesh.points, mesh.uv
    points["colour"][:, :3], points["colour"][:, 3] = colours, 255
    data.modifyArrayHandle(0).copyDataFrom(points.tobytes())


def _fill_texture(texture: core.Texture, pixels: np.ndarray) -> None:
    height, width, channels = pixels.shape
    kind = core.Texture.FRgba if channels == 4 else core.Texture.FRgb
    texture.setup2dTexture(width, height, core.Texture.TUnsignedByte, kind)
    order = [2, 1, 0, 3][:channels]  # Panda3D stores blue first and the lowest row first
    for number, level in enumerate(halvings(texture.getName(), pixels)):
        stored = np.ascontiguousarray(level[::-1, :, order]).tobytes()
        texture.setRamMipmapImage(number, core.CPTA_uchar(stored))
    texture.setMagfilter(core.SamplerState.FTLinear)
    sharp = texture.getName() == "plants"  # blurred borders flicker at a distance
    texture.setMinfilter(
        core.SamplerState.FTNearest if sharp else core.SamplerState.FTLinearMipmapLinear
    )

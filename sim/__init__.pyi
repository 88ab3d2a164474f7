"""The public names for type checkers and editors; at run time each is imported when it is first asked for."""

from sim.compensation import STRATEGIES as STRATEGIES
from sim.compensation import Compensation as Compensation
from sim.compensation import Strategy as Strategy
from sim.compensation import compensate as compensate
from sim.errors import SimulationError as SimulationError
from sim.form_factors.compressed import compressed_form_factors as compressed_form_factors
from sim.form_factors.factors import FormFactors as FormFactors
from sim.form_factors.factors import form_factors as form_factors
from sim.frame.compensator import FrameCompensator as FrameCompensator
from sim.frame.model import frame_model as frame_model
from sim.geometry.mesh import Mesh as Mesh
from sim.geometry.optics import Lens as Lens
from sim.geometry.optics import Pose as Pose
from sim.geometry.scene import Scene as Scene
from sim.light.colour import ColourTransport as ColourTransport
from sim.light.gloss.material import Gloss as Gloss
from sim.light.gloss.transport import GlossyTransport as GlossyTransport
from sim.light.gloss.transport_of_scene import glossy_transport as glossy_transport
from sim.light.radiosity import Radiosity as Radiosity
from sim.light.transport import LightTransport as LightTransport
from sim.light.transport_of_scene import coaxial_transport as coaxial_transport
from sim.light.transport_of_scene import physical_transport as physical_transport
from sim.picture.image import simulate_image as simulate_image
from sim.planning.plan import plan as plan
from sim.planning.simulation import simulate as simulate
from sim.scenes.gridded import paper_room as paper_room
from sim.scenes.gridded import room as room
from sim.scenes.gridded import room_with_box as room_with_box

__version__: str

from .arguments import AsPublished as AsPublished, Objective as Objective, Search as Search
from .multiscale import Level as Level, reconstruct_multiscale as reconstruct_multiscale
from .preimage import reconstruct as reconstruct
from .prior.choice import default_prior as default_prior
from .prior.learned import LearnedPrior as LearnedPrior
from .prior.terms import Prior as Prior
from .prior.training import train_prior as train_prior
from .reconstruction import Iterate as Iterate, Reconstruction as Reconstruction
from .samples import Samples as Samples, reconstruct_samples as reconstruct_samples
from .scales import scale_descriptors as scale_descriptors
from .template import reconstruct_template as reconstruct_template, template_descriptor as template_descriptor
from .candidates import Candidate as Candidate
from .which import WhichHOG as WhichHOG, which_hog as which_hog

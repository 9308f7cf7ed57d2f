"""
MaskFeat: targets and predictions as pictures
=============================================

MaskFeat trains a network to predict the HOG of masked patches. Its targets are tokens: 196 rows of 108 numbers of
an image of 224x224 pixels, 2x2 cells of 9 bins of 3 colours each. How do they become a picture, and what does a
prediction look like?
"""

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.patches import Rectangle
from PIL import Image
from skimage import data
from torch import Tensor, nn
from torch.nn.functional import mse_loss

import nablahog

# %%
# Targets
# -------
# ``layout="tokens"`` is the layout of MaskFeat's targets.

spec = nablahog.presets.maskfeat(layout="tokens")
photograph = np.array(Image.fromarray(data.chelsea()).crop((60, 10, 340, 290)).resize((224, 224)))
image = torch.from_numpy(photograph).permute(2, 0, 1)[None]  # (1, 3, 224, 224)
tokens = nablahog.hog(image, spec, layout="native")
print(f"targets {tuple(tokens.shape)}, tokens of a 14x14 grid")

# %%
# The order of the 108 numbers is that of SlowFast's ``_get_hog_label_2d``: colour, bin, row and column of the cell. Its
# own lines, applied to the descriptor as planes, give the same array:

descriptor = nablahog.hog(image, spec)  # (B, 28, 28, 27), the cells side by side
planes = descriptor.permute(0, 3, 1, 2)
unfold = planes.shape[-1] // 14
labels = planes.permute(0, 2, 3, 1).unfold(1, unfold, unfold).unfold(2, unfold, unfold).flatten(1, 2).flatten(2)
print("the order of SlowFast's labels:", torch.equal(labels, tokens))

# %%
# Tokens as pictures
# ------------------
# ``from_layout`` folds tokens, also those of a network, into (rows, cols, channels), for ``glyphs`` and
# ``reconstruct``.

folded = nablahog.from_layout(tokens, spec, (224, 224))
result = nablahog.reconstruct(folded, spec, (224, 224), quality="fast", seed=0)
figure, panels = plt.subplots(1, 3, figsize=(10, 3.7), layout="constrained")
for axes, picture, title in zip(
    panels,
    (photograph, nablahog.glyphs(folded[0], spec), result.image[0, 0]),
    ("photograph, 224x224 pixels", "its targets as glyphs, mean of the colours", "pre-image of the targets"),
    strict=True,
):
    axes.imshow(picture, cmap="gray")
    axes.set_title(title, fontsize=10)
    axes.set_axis_off()
plt.show()

# %%
# A network
# ---------
# A transformer of two layers, images of 112x112 pixels, which are 7x7 tokens, and a few seconds of training on crops of
# six photographs. This is no MaskFeat model; it is enough to look at a prediction.

SIDE, GRID, WIDTH = 112, 7, 64
torch.manual_seed(0)
generator = np.random.default_rng(0)
names = ("astronaut", "camera", "coffee", "rocket", "coins", "clock")
sources = [Image.fromarray(getattr(data, name)()).convert("RGB") for name in names]


def crops(count: int) -> Tensor:
    """Random crops (count, 3, SIDE, SIDE), uint8, of the photographs."""
    result = []
    for k in range(count):
        source = sources[k % len(sources)]
        side = int(generator.integers(SIDE, min(source.size)))
        x, y = (int(generator.integers(0, n - side + 1)) for n in source.size)
        result.append(np.array(source.crop((x, y, x + side, y + side)).resize((SIDE, SIDE))))
    return torch.from_numpy(np.stack(result)).permute(0, 3, 1, 2)


class Predictor(nn.Module):
    """Images with masked patches (B, 3, SIDE, SIDE) and masks (B, GRID²) to tokens (B, GRID², 108)."""

    def __init__(self) -> None:
        super().__init__()
        self.patches = nn.Conv2d(3, WIDTH, 16, stride=16)
        self.masked = nn.Parameter(torch.zeros(WIDTH))
        self.places = nn.Parameter(0.02 * torch.randn(GRID**2, WIDTH))
        layer = nn.TransformerEncoderLayer(WIDTH, 4, 2 * WIDTH, dropout=0.0, batch_first=True, norm_first=True)
        self.encoder = nn.TransformerEncoder(layer, 2, enable_nested_tensor=False)
        self.head = nn.Linear(WIDTH, 108)

    def forward(self, images: Tensor, mask: Tensor) -> Tensor:
        tokens = self.patches(images).flatten(2).transpose(1, 2)
        tokens = torch.where(mask[:, :, None], self.masked, tokens) + self.places
        predicted: Tensor = self.head(self.encoder(tokens))
        return predicted


def random_mask(count: int) -> Tensor:
    """40 % of the tokens, (count, GRID²)."""
    return torch.rand(count, GRID**2).argsort(dim=1) < 0.4 * GRID**2


# %%
# The loss is MaskFeat's: the mean squared error of the masked tokens.

network = Predictor()
optimizer = torch.optim.AdamW(network.parameters(), lr=3e-3)
examples = crops(384)
labels = nablahog.hog(examples, spec, layout="native")
losses = []
for _ in range(120):
    chosen = torch.from_numpy(generator.integers(0, len(examples), 32))
    mask = random_mask(32)
    predicted = network(examples[chosen] / 255 - 0.5, mask)
    loss = mse_loss(predicted[mask], labels[chosen][mask])
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
    losses.append(float(loss.detach()))
print(
    f"mean squared error, means of 20 steps: {np.mean(losses[:20]):.4f} at first, {np.mean(losses[-20:]):.4f} at last"
)
print(f"of the mean token, for comparison: {float((labels - labels.mean((0, 1))).square().mean()):.4f}")

# %%
# Predictions as pictures
# -----------------------
# A photograph that is not among the six. What is masked is predicted, the rest of the tokens is the target.

test = torch.from_numpy(photograph).permute(2, 0, 1)[None, :, ::2, ::2]
target = nablahog.hog(test, spec, layout="native")
mask = random_mask(1)
with torch.no_grad():
    predicted = network(test / 255 - 0.5, mask).clamp(min=0)  # a HOG has no negative votes
mixed = torch.where(mask[:, :, None], predicted, target)
print(
    f"mean squared error of the masked tokens of this photograph: {float(mse_loss(predicted[mask], target[mask])):.4f}"
)

large = mask.reshape(GRID, GRID).repeat_interleave(16, 0).repeat_interleave(16, 1)
seen = np.where(large[:, :, None], 128, test[0].permute(1, 2, 0).numpy())
figure, panels = plt.subplots(1, 5, figsize=(12, 2.8), layout="constrained")
panels[0].imshow(seen)
panels[0].set_title("what the network sees", fontsize=10)
for k, (part, title) in enumerate(((target, "targets"), (mixed, "predicted where masked"))):
    folded = nablahog.from_layout(part, spec, (SIDE, SIDE))
    panels[1 + k].imshow(nablahog.glyphs(folded[0], spec), cmap="gray")
    panels[1 + k].set_title(title, fontsize=10)
    result = nablahog.reconstruct(folded, spec, (SIDE, SIDE), quality="fast", seed=0)
    panels[3 + k].imshow(result.image[0, 0], cmap="gray", vmin=0, vmax=1)
    panels[3 + k].set_title(f"pre-image, {'targets' if k == 0 else 'with predictions'}", fontsize=10)
for y, x in (large.reshape(GRID, 16, GRID, 16)[:, 0, :, 0]).nonzero().tolist():
    box = Rectangle((32 * x, 32 * y), 32, 32, fill=False, edgecolor="orange", linewidth=1)
    panels[2].add_patch(box)
for axes in panels:
    axes.set_axis_off()
plt.show()

# %%
# Orange: masked tokens. Predictions of so little training are nearly the mean token: all orientations are about equally
# strong, a star in the glyphs, and the pre-image has no edges there.

# docker build -t drivezoo . && docker run --rm -v "$PWD/outputs:/drivezoo/outputs" drivezoo
FROM python:3.12-slim
RUN apt-get update && apt-get install --yes --no-install-recommends libx11-6 make && rm -rf /var/lib/apt/lists/*
WORKDIR /drivezoo
COPY . .
# PyTorch for the CPU alone: PyPI's brings several GB for GPUs.
RUN PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu make setup
CMD ["make", "demo"]

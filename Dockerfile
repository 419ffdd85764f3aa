# massprops in a container: docker build -t massprops . && docker run --rm -v "$PWD:/data" massprops reconstruct video.mp4 -o run
FROM python:3.12-slim

# What the wheels of open3d, pymeshlab and opencv ask the system for (`massprops doctor` names what is missing).
# The base image's release fixes their versions.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install -y --no-install-recommends libgomp1 libgl1 libegl1 libglu1-mesa libopengl0 libx11-6 libxcb1 libusb-1.0-0 \
    && rm -rf /var/lib/apt/lists/*

COPY . /source
RUN pip install --no-cache-dir "/source[cluster]" && rm -rf /source && massprops doctor

RUN useradd --create-home --uid 1000 user
USER 1000
WORKDIR /data
ENTRYPOINT ["massprops"]
CMD ["--help"]

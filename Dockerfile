# fingerfit with CalculiX, for a machine without Python:
#   docker build --tag fingerfit .
#   docker run --rm --user "$(id -u):$(id -g)" --volume "$PWD:/work" fingerfit run studies/mine
FROM python:3.11-slim-bookworm

# CalculiX, the second solver; without the pin of its version, since Debian keeps one only
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --yes --no-install-recommends calculix-ccx \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /source
COPY requirements.lock ./
RUN pip install --no-cache-dir --requirement requirements.lock
COPY . .
RUN pip install --no-cache-dir --no-deps --no-build-isolation .

# whoever runs it may have no home: caches of matplotlib and Snakemake go to a folder that all may write
ENV HOME=/tmp
WORKDIR /work
ENTRYPOINT ["fingerfit"]
CMD ["--help"]

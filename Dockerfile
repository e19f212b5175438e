# A CPU image: docker build -t tex_lightning . && docker run --rm -v "$PWD:/data" tex_lightning model=fusion
# It was written without a container engine at hand and has not been built yet.
FROM python:3.11-slim
COPY . /src
RUN pip install --no-cache-dir --extra-index-url https://download.pytorch.org/whl/cpu \
        -c /src/constraints.txt "/src[baselines,export,imagenet]" \
    && rm -r /src
WORKDIR /data
ENTRYPOINT ["python", "-m", "tex_lightning"]
CMD ["--help"]

# facets and its virtual bench: docker run --rm facets simulate paper --folder /tmp/paper
# Without extras, whose libraries take 1.4 GB: pip install them on top of it.
FROM python:3.13-slim AS build
COPY . /source
RUN python -m venv /opt/facets \
 && /opt/facets/bin/pip install --no-cache-dir /source \
 && find /opt/facets -depth -name tests -type d -exec rm -rf {} +

FROM python:3.13-slim
COPY --from=build /opt/facets /opt/facets
RUN useradd --uid 1000 --create-home facets
USER 1000:1000
WORKDIR /home/facets
ENV PATH=/opt/facets/bin:$PATH
ENTRYPOINT ["facets"]
CMD ["--help"]

// The description of the interface, from this service's own OpenAPI document.
import SwaggerUIBundle from "swagger-ui-dist/swagger-ui-bundle.js";

SwaggerUIBundle({
  url: `${document.documentElement.dataset.base}/openapi.json`,
  domNode: document.getElementById("docs"),
  deepLinking: true,
  docExpansion: "list",
  defaultModelsExpandDepth: 0,
  validatorUrl: null,
  // a session of the browser is good for changes that a page of this service asks for
  requestInterceptor: (request) => ({ ...request, headers: { ...request.headers, "Tieline-Page": "1" } }),
});

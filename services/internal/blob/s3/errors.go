package s3

import (
	"context"
	"errors"
	"fmt"
	"net"
	"net/url"

	"github.com/minio/minio-go/v7"

	"metrofarm/services/internal/blob"
)

// explain says which setting an error of the store is about. action is what was tried: "read",
// "write".
func (b *Backend) explain(action string, err error) error {
	if err == nil || errors.Is(err, context.Canceled) || errors.Is(err, context.DeadlineExceeded) {
		return err
	}
	switch response := minio.ToErrorResponse(err); response.Code {
	case minio.NoSuchKey, "NoSuchUpload":
		return blob.ErrNotFound
	case minio.NoSuchBucket:
		return fmt.Errorf("%s has no bucket %q; create it, or name another one by --blobs", b.options.endpoint(), b.options.Bucket)
	case minio.AccessDenied, "AllAccessDisabled", "Forbidden":
		return fmt.Errorf("access denied: the user of AWS_ACCESS_KEY_ID may not %s in bucket %q", action, b.options.Bucket)
	case "InvalidAccessKeyId":
		return fmt.Errorf("%s does not know the key in AWS_ACCESS_KEY_ID", b.options.endpoint())
	case "SignatureDoesNotMatch":
		return fmt.Errorf("%s refuses the signature: AWS_SECRET_ACCESS_KEY is not that of AWS_ACCESS_KEY_ID", b.options.endpoint())
	case "ExpiredToken", "InvalidToken":
		return fmt.Errorf("AWS_SESSION_TOKEN is no longer valid: %s", response.Message)
	case "AuthorizationHeaderMalformed", "PermanentRedirect", "InvalidRegion":
		return fmt.Errorf("bucket %q is in another region; set --s3-region: %s", b.options.Bucket, response.Message)
	}
	var dial *net.OpError
	var request *url.Error
	if errors.As(err, &dial) && dial.Op == "dial" || errors.As(err, &request) {
		return fmt.Errorf("%s (--s3-endpoint) cannot be reached: %w", b.options.endpoint(), err)
	}
	return err
}
